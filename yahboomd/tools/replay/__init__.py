"""``yahboomd replay``: computes the poses of a black box again."""
