"""Motion, sensing and uncertainty models: numpy only, no GTSAM."""
