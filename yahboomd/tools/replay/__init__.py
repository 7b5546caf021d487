"""``yahboomd replay``: plays a recorded board on a pseudo-terminal, or computes its poses again."""
