"""Robots as processes: one robot's process, what starts one a robot, and what they hand in."""
