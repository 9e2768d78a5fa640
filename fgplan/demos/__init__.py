"""Demonstrations on real input, one command each."""
