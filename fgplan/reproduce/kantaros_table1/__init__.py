"""Table I of Kantaros et al. 2019."""
