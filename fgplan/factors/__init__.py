"""The GTSAM boundary: keys, noise, factor makers, whitened rows."""
