"""The page's server reads the configuration in another process, where pydantic stays."""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

import pytest

from yahboomd.cli.web import read_config_apart
from yahboomd.core.errors import ConfigError


def options(text: str, tmp_path: Path) -> argparse.Namespace:
    path = tmp_path / "robot.toml"
    path.write_text(text)
    overrides = ["web.camera=http://127.0.0.1:8080/stream"]
    return argparse.Namespace(config=path, overrides=overrides, source=None, connect=None)


def test_its_values_and_its_mistakes_come_back(tmp_path: Path) -> None:
    read = read_config_apart(options("[zenoh]\nnamespace = 'bot1'\n", tmp_path))
    assert read.options.namespace == "bot1"
    assert read.options.connect == ("tcp/127.0.0.1:7448", "tcp/127.0.0.1:7447")
    assert read.source == "cmd_vel/web"
    assert read.camera == "http://127.0.0.1:8080/stream"
    assert read.path == tmp_path / "robot.toml"
    with pytest.raises(ConfigError, match=r"robot\.toml:2: serial\.prot: unknown key"):
        read_config_apart(options("[serial]\nprot = 1\n", tmp_path))


def test_the_page_loads_neither_models_nor_checks(tmp_path: Path) -> None:
    args = options("", tmp_path)
    program = (
        "import sys; from argparse import Namespace; from pathlib import PosixPath\n"
        "import yahboomd.web.page_hub, yahboomd.web.web_server\n"
        "from yahboomd.cli.web import read_config_apart\n"
        f"read_config_apart({args!r})\n"
        "print([name for name in sys.modules if name in ('pydantic', 'yahboomd.core.config')])\n"
    )
    ran = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert ran.stdout == "[]\n"
