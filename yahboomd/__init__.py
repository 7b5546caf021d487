"""yahboomd: a daemon that drives Yahboom encoder motor boards from a Zenoh bus.

`docs/architecture.md` lists the packages and who may import whom. :mod:`yahboomd.client` is the
Python client; everything else serves the daemon and its command line.
"""

import os

RELEASE = "0.1.0"
"""The release that is being made, for what is written before it is built: schemas, man pages."""


def _built() -> str:
    """The version of this build: the last tag of the source, and the commits since.

    A source that was never built has none; what it runs is unknown.
    """
    try:
        with open(os.path.join(os.path.dirname(__file__), "_version.txt")) as written:
            return written.read().strip()
    except OSError:
        return f"{RELEASE}+source"


__version__ = _built()
