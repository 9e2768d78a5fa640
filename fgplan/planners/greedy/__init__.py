"""Greedy choice of controls, each robot for itself."""
