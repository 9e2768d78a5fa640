"""Impacted paths: announced candidate paths, best response until nobody changes."""
