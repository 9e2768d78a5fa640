"""Table I of Tzes et al. 2021."""
