"""Configuration: ``config.toml``, ``YAHBOOMD_…`` variables and ``--set`` as one checked value.

:func:`load` reads all three and reports every mistake at once, with file, line and key. `models`
has the keys, their defaults and their rules; the reference page is written from it.
"""

from yahboomd.config.loading import STANDARD_PATH, Loaded, load, read
from yahboomd.config.models import WHEELS, Config, runtime_folder

__all__ = ["STANDARD_PATH", "WHEELS", "Config", "Loaded", "load", "read", "runtime_folder"]
