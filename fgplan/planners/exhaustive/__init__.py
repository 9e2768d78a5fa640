"""Exhaustive: every combination of candidate paths of a small team."""
