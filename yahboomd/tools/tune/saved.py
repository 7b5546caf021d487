"""The file with a board's settings from before a tuning; it exists before the first write.

The file is written atomically, and is on the disk before the board is changed. A tuning that was
killed leaves it unfinished: then the next one keeps it, since the board has trial values.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from hashlib import sha256
from pathlib import Path
from urllib.parse import quote

import msgspec

from yahboomd.core.atomic_write import sync_folder, write_atomic
from yahboomd.core.config import Config
from yahboomd.core.config.models import calibration_path
from yahboomd.core.errors import ConfigError, Refused
from yahboomd.core.protocol.settings import BoardSettings, SettingValue

NAME = "before-tune"
LARGEST_BYTES = 100_000


class SavedSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The file.

    Attributes:
        made: The date and time, UTC.
        port: The board's port, as it was named or found.
        finished: The tuning ran to its end.
    """

    made: str
    port: str
    dialect: str
    settings: dict[str, int | float | str | tuple[float, float, float]]
    finished: bool = False


def saved_path(config: Config, environ: Mapping[str, str], file: Path | None) -> Path:
    """The file of a configuration, beside its calibration.

    Raises:
        ConfigError: There is no state directory.
    """
    beside = calibration_path(config, environ, file, user_id=os.getuid())
    if beside is None:
        raise ConfigError(
            "There is no folder to save the board's settings in, so the board is not changed.",
            remedy="Set STATE_DIRECTORY, or HOME.",
        )
    name, port = NAME, quote(config.serial.port, safe="")
    if config.zenoh.namespace:
        name += f".{quote(config.zenoh.namespace, safe='')}"
    if port:
        name += f"@{port if len(port) <= 120 else sha256(port.encode()).hexdigest()}"
    return beside.with_name(f"{name}.json")


def read_saved(path: Path) -> SavedSettings | None:
    """The saved settings; None if there are none.

    Raises:
        Refused: The file cannot be used.
    """
    try:
        with path.open("rb") as file:
            return msgspec.json.decode(file.read(LARGEST_BYTES), type=SavedSettings)
    except FileNotFoundError:
        return None
    except OSError as error:
        raise Refused(f"{path} cannot be read: {error.strerror}.") from error
    except (msgspec.MsgspecError, ValueError) as error:
        raise Refused(
            f"{path} has no settings of a board: {error}.",
            remedy="Remove it, and store gains by `yahboomd probe --write --pid P,I,D`.",
        ) from error


def save(path: Path, found: SavedSettings) -> SavedSettings:
    """Write the file, unless one of a killed tuning is there: that has the board's own values.

    Returns:
        The settings in the file.

    Raises:
        Refused: It cannot be written: the board must not be changed.
    """
    before = read_saved(path)
    if before is not None and not before.finished and before.dialect == found.dialect:
        return before
    _write(path, found)
    return found


def check_place(path: Path, port: str) -> None:
    """Check that :func:`save` will work, by writing a temporary file beside the path.

    Raises:
        Refused: It will not.
    """
    read_saved(path)
    _write(path, SavedSettings(made="", port=port, dialect="", settings={}), stays=False)


def finish(path: Path, saved: SavedSettings) -> None:
    """Mark the tuning as finished, so that the next one saves the board's values again.

    Raises:
        Refused: It cannot be written.
    """
    _write(path, msgspec.structs.replace(saved, finished=True))


def remove(path: Path) -> None:
    """Remove the file, and sync the folder."""
    path.unlink(missing_ok=True)
    sync_folder(path.parent)


def settings_of(saved: SavedSettings) -> BoardSettings:
    """The saved values as settings."""
    values: dict[str, SettingValue] = dict(saved.settings)
    return values


def _write(path: Path, saved: SavedSettings, *, stays: bool = True) -> None:
    beside = path.with_name(f".{path.name}.new")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        data = msgspec.json.format(msgspec.json.encode(saved), indent=2) + b"\n"
        write_atomic(path if stays else beside, data)
        if not stays:
            beside.unlink()
    except OSError as error:
        raise Refused(
            f"{path} cannot be written: {error.strerror}. The board was not changed.",
            remedy="Run the same command with sudo, or set STATE_DIRECTORY.",
        ) from error
