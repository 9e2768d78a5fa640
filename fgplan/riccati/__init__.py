"""Gaussian filtering of a linear hidden state: numpy only, letters as each module's legend says."""
