"""Reads the configuration in a process that ends: its checks need 10 MB, which end with it."""

from __future__ import annotations

import argparse
import os
import pickle
import sys
from pathlib import Path
from typing import NamedTuple

from yahboomd.cli.shared_options import read_config
from yahboomd.core.config import Config
from yahboomd.core.errors import ConfigError


class ReadApart(NamedTuple):
    """A configuration, and the file that it was read from, if any."""

    config: Config
    path: Path | None


def read_config_apart(args: argparse.Namespace) -> ReadApart:
    """Read the configuration that the shared options describe.

    Call it before there are threads, which do not survive in the other process.

    Raises:
        ConfigError: The configuration has mistakes; the error names each.
    """
    sys.stdout.flush()
    sys.stderr.flush()
    reading, writing = os.pipe()
    if (child := os.fork()) == 0:
        # The child never returns: it would end what is the parent's.
        try:
            os.close(reading)
            with os.fdopen(writing, "wb") as pipe:
                pickle.dump(_read(args), pipe)
        finally:
            os._exit(0)
    os.close(writing)
    with os.fdopen(reading, "rb") as pipe:
        answer = pipe.read()
    os.waitpid(child, 0)
    # Without an answer the child failed: the same here shows why.
    # It comes from our own process.
    found: ReadApart | tuple[str, str] = pickle.loads(answer) if answer else _read(args)  # noqa: S301
    if not isinstance(found, ReadApart):
        message, remedy = found
        raise ConfigError(message, remedy=remedy)
    return found


def _read(args: argparse.Namespace) -> ReadApart | tuple[str, str]:
    try:
        loaded = read_config(args)
    except ConfigError as error:
        return error.message, error.remedy
    return ReadApart(loaded.config, loaded.path)
