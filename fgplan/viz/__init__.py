"""Figures of maps, paths, beliefs and running times; needs the extra ``viz``."""
