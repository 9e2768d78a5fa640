"""Section 7.2 of Regev and Indelman 2017: Scenarios 1, 2 and 3 in closed loop."""
