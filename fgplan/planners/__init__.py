"""Planners: one folder each, chosen by name, all with one interface."""
