"""yahboomd: a daemon that drives Yahboom encoder motor boards from a Zenoh bus."""

__version__ = "0.1.0"
