"""Robots as values, what carries their messages, and the loop that makes them agree."""
