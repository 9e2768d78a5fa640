"""Objectives, impact, and the evaluators that re-evaluate candidate paths."""
