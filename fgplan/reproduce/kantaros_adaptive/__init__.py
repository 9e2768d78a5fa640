"""Replanning on measurements: the remark of section VI-A of Kantaros et al. 2019."""
