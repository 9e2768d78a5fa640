"""RIG-tree with the objective and constraint of Kantaros et al. 2019."""
