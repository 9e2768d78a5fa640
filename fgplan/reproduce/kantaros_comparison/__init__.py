"""Section VI-C of Kantaros et al. 2019: comparison with other planners."""
