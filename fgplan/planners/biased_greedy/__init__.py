"""Greedy choice of controls by coordinate descent, with the biased density of aia."""
