"""Section 7.1 of Regev and Indelman 2017: figures 5, 6 and 7."""
