"""Beliefs: what a factor graph knows, read by square-root elimination."""
