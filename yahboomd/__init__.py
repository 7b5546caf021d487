"""yahboomd: a daemon that drives Yahboom encoder motor boards from a Zenoh bus.

`docs/architecture.md` lists the packages and who may import whom. :mod:`yahboomd.client` is the
Python client; everything else serves the daemon and its command line.
"""

__version__ = "0.1.0"
