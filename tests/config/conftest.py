from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from yahboomd.core.config import Loaded, read
from yahboomd.core.errors import ConfigError

Write = Callable[[str], Path]
Complaints = Callable[..., list[str]]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Write a configuration, in a file that is called config.toml."""

    def written(text: str) -> Path:
        path = tmp_path / "config.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return written


@pytest.fixture
def given(tmp_path: Path, write: Write) -> Callable[..., Loaded]:
    """Read text, environment and overrides, and nothing of this machine."""

    def read_them(text: str = "", *overrides: str, **environ: str) -> Loaded:
        return read(
            write(text),
            environ=environ,
            overrides=overrides,
            standard_path=tmp_path / "none.toml",
        )

    return read_them


@pytest.fixture
def complaints(tmp_path: Path, given: Callable[..., Loaded]) -> Complaints:
    """The lines about the mistakes in a configuration, without the folder of the file."""

    def lines(text: str = "", *overrides: str, **environ: str) -> list[str]:
        with pytest.raises(ConfigError) as refused:
            given(text, *overrides, **environ)
        head, *rest = refused.value.message.replace(f"{tmp_path}/", "").split("\n")
        assert head == (
            "The configuration has a mistake:"
            if len(rest) == 1
            else f"The configuration has {len(rest)} mistakes:"
        )
        return rest

    return lines
