"""``yahboomd replay``: a recorded board on a pseudo-terminal, and its poses computed again."""
