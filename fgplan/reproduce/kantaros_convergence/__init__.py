"""Theorem 4.3 of Kantaros et al. 2019: how fast the tree holds the optimal path."""
