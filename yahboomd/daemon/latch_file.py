"""The e-stop's memory: a file that is there while the latch is engaged, and survives a restart."""

from __future__ import annotations

import json
import logging
import os
import tempfile
from pathlib import Path

log = logging.getLogger(__name__)


class LatchFile:
    """Remembers an engaged e-stop.

    A latch that cannot be remembered still holds while the process lives; a file that cannot be
    read counts as engaged, since somebody wrote it.

    Args:
        path: Where it lies; its folder is made when needed.
    """

    def __init__(self, path: Path) -> None:
        self._path = path

    def load(self) -> str | None:
        """Who engaged the latch that is on file; ``None`` where it is not engaged."""
        try:
            text = self._path.read_text(encoding="utf-8")
        except FileNotFoundError:
            return None
        except (OSError, UnicodeDecodeError) as error:
            log.warning("%s cannot be read (%s): the e-stop counts as engaged", self._path, error)
            return "unknown (its file cannot be read)"
        try:
            by = json.loads(text)["by"]
        except (ValueError, KeyError, TypeError):
            return "unknown (its file is damaged)"
        return str(by)

    def engage(self, by: str) -> bool:
        """Write it down, whole or not at all; whether that worked."""
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            fd, name = tempfile.mkstemp(dir=self._path.parent, prefix=".estop-")
            with os.fdopen(fd, "w", encoding="utf-8") as file:
                json.dump({"engaged": True, "by": by}, file)
            os.replace(name, self._path)
        except OSError as error:
            log.warning(
                "the e-stop holds, but %s cannot be written (%s): it would not survive a restart",
                self._path,
                error,
            )
            return False
        return True

    def release(self) -> bool:
        """Forget it; whether that worked. Where it did not, the latch must stay engaged."""
        try:
            self._path.unlink(missing_ok=True)
        except OSError as error:
            log.warning("%s cannot be removed (%s): the e-stop stays engaged", self._path, error)
            return False
        return True
