"""Benchmarks, one command each: ``fgplan bench NAME``."""
