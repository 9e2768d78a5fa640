"""Candidate paths: states with pose, step and time, and what will be measured along them."""
