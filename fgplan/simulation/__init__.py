"""A world with truth, and one closed loop that moves, senses and draws noise."""
