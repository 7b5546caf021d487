"""Writes the calibration file, and undoes it: the daemon only reads it."""

from __future__ import annotations

import os
from pathlib import Path

from yahboomd.core.atomic_write import sync_folder, write_atomic
from yahboomd.core.config.calibration_file import LARGEST_BYTES, Calibration, read_calibration
from yahboomd.core.config.reading import read_named
from yahboomd.core.config.values import inline
from yahboomd.core.errors import ConfigError

PREVIOUS = "calibration.previous.toml"


def write_calibration(path: Path, calibration: Calibration) -> None:
    """Replace it in one step; a copy of the one before is kept for :func:`undo_calibration`.

    Raises:
        ConfigError: The folder cannot be written to.
    """
    lines = [
        "# Written by `yahboomd calibrate`, and read over config.toml. `yahboomd calibrate undo`",
        "# takes it back; removing this file does too.",
    ]
    for key, value in calibration.as_data().items():
        if isinstance(value, dict):
            lines += ["", f"[{key}]", *(f"{name} = {inline(each)}" for name, each in value.items())]
        else:
            lines.append(f"{key} = {inline(value)}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if os.path.lexists(path):
            # A copy, since a link to another user's file may be forbidden.
            before = read_named(path, LARGEST_BYTES, wait_s=0)
            write_atomic(path.with_name(PREVIOUS), before)
        write_atomic(path, "\n".join([*lines, ""]).encode())
    except OSError as error:
        raise _unwritable(path, error.strerror) from error


def check_writable(path: Path) -> None:
    """Check that the file can be written, before a person measures anything.

    Raises:
        ConfigError: The folder cannot be written to, or made.
    """
    folder = path.parent
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    if not (folder.is_dir() and os.access(folder, os.W_OK | os.X_OK)):
        raise _unwritable(path, f"no permission for {folder}")


def undo_calibration(path: Path) -> bool:
    """Remove the newest calibration, and restore the one before it if there was one.

    Returns:
        Whether there was one to undo.

    Raises:
        ConfigError: The folder cannot be written to, or the file is not a calibration.
    """
    if os.path.lexists(path):
        # A mistyped name must not delete another file.
        try:
            read_calibration(path)
        except ConfigError as error:
            words = f"If it is a calibration that was damaged: `rm {path}`, then undo again."
            raise ConfigError(str(error), remedy=words) from error
    try:
        path.with_name(PREVIOUS).replace(path)
        sync_folder(path.parent)
    except FileNotFoundError:
        try:
            path.unlink()
        except FileNotFoundError:
            return False
        except OSError as error:
            raise _unwritable(path, error.strerror) from error
    except OSError as error:
        raise _unwritable(path, error.strerror) from error
    return True


def _unwritable(path: Path, why: str | None) -> ConfigError:
    return ConfigError(
        f"{path} cannot be written: {why}.",
        remedy="Run the same command with sudo, or name another file: "
        "`--set chassis.calibration_file=/path/to/calibration.toml`.",
    )
