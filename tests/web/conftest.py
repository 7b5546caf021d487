from __future__ import annotations

from fake_daemon import fake_daemon
from web_site import site

__all__ = ["fake_daemon", "site"]
