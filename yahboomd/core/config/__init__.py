"""Configuration: ``config.toml``, ``YAHBOOMD_…`` variables and ``--set`` as one checked value.

:func:`read` reads all three and reports every mistake at once, with file, line and key. `hardware`,
`driving` and `outputs` have the keys and their defaults, `rules` compares keys with each other; the
reference page is written from them.
"""

from yahboomd.core.config.loading import Loaded, read, read_foreign
from yahboomd.core.config.models import Config, runtime_folder

__all__ = ["Config", "Loaded", "read", "read_foreign", "runtime_folder"]
