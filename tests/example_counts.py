"""Examples of slow property tests: a quarter of the profile's, but never fewer than ``dev``."""

from hypothesis import settings

FEWER = max(25, settings.default.max_examples // 4)
