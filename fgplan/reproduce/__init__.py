"""Published tables and figures beside ours, one folder each."""
