"""The large workspace of section VI-B of Kantaros et al. 2019."""
