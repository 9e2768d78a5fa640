"""Recordings of a closed loop for other people's viewers; each format is an extra of its own."""
