"""Sampling-tree planner for active information acquisition (Kantaros et al. 2019)."""
