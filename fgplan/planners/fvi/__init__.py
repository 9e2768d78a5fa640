"""Feedforward value iteration: exhaustive, exact."""
