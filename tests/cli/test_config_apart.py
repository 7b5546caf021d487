"""The configuration is read by another process: the same values and mistakes, no checks here."""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

from yahboomd.cli.shared_options import read_config
from yahboomd.cli.web import read_config_apart


def options(text: str, tmp_path: Path) -> argparse.Namespace:
    path = tmp_path / "robot.toml"
    path.write_text(text)
    return argparse.Namespace(config=path, overrides=["log.level=debug"])


def test_it_reads_the_same_as_here(tmp_path: Path) -> None:
    args = options("[zenoh]\nnamespace = 'bot1'\n[limits]\nlinear = { velocity = 0.5 }\n", tmp_path)
    loaded = read_config(args)
    assert read_config_apart(args) == (loaded.config, loaded.path)


def test_the_checks_are_not_loaded_here(tmp_path: Path) -> None:
    args = options("", tmp_path)
    program = (
        "import argparse, sys; from pathlib import Path\n"
        "from yahboomd.cli.web import read_config_apart\n"
        f"read_config_apart(argparse.Namespace(config=Path({str(args.config)!r}), overrides=[]))\n"
        "print('pydantic' in sys.modules)\n"
    )
    ran = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert ran.stdout == "False\n"
