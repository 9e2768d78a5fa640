"""Files in and out: scenarios, pose graphs, run folders and results."""
