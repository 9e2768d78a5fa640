"""Figure 4 of Tzes et al. 2021."""
