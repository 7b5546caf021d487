"""What humans write: ``config.toml``, ``YAHBOOMD_…`` variables and ``--set``, read in one place."""

from yahboomd.config.loading import STANDARD_PATH, Loaded, load, read
from yahboomd.config.models import WHEELS, Config, runtime_folder

__all__ = ["STANDARD_PATH", "WHEELS", "Config", "Loaded", "load", "read", "runtime_folder"]
