"""Planner ``distributed_aia`` of Tzes, Kantaros and Pappas 2021: one sampling tree a robot."""
