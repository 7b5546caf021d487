"""A recording becomes a picture."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from pose_recording import record

from yahboomd.cli.main import main
from yahboomd.cli.plot import ellipse

# The library is imported once, by one worker.
pytestmark = pytest.mark.xdist_group("pictures")


@pytest.mark.cases(1)
@pytest.mark.parametrize(("kind", "begins"), [("png", b"\x89PNG"), ("svg", b"<?xml")])
def test_a_folder_is_drawn_to_a_file_of_the_kind_that_is_named(
    tmp_path: Path, kind: str, begins: bytes, capsys
) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    record(folder, 500)
    output = tmp_path / f"picture.{kind}"
    assert main(["plot", str(folder), "--output", str(output)]) == 0
    assert output.read_bytes().startswith(begins)
    assert output.stat().st_size > 20_000
    assert capsys.readouterr().out.strip() == str(output)


@pytest.mark.parametrize("name", ["picture.doc", "picture", "no/picture.png"])
def test_a_kind_that_cannot_be_drawn_is_named_and_costs_no_file(
    tmp_path: Path, capsys, name: str
) -> None:
    record(tmp_path, 300)
    kept = tmp_path / name
    if kept.parent.is_dir():
        kept.write_text("another file")
    assert main(["plot", str(tmp_path), "--output", str(kept)]) == 1
    words = capsys.readouterr().err
    assert "is no picture: name a file that ends in" in words or "There is no folder" in words
    assert not kept.parent.is_dir() or kept.read_text() == "another file"
    assert not list(tmp_path.glob("*.png"))


def test_the_ellipse_is_that_of_the_covariance() -> None:
    # Turned by 30 degrees, 0.3 m and 0.1 m at one sigma.
    cos, sin = math.cos(math.pi / 6), math.sin(math.pi / 6)
    xx, yy = 0.09 * cos**2 + 0.01 * sin**2, 0.09 * sin**2 + 0.01 * cos**2
    xy = (0.09 - 0.01) * cos * sin
    assert ellipse((xx, xy, 0, xy, yy, 0, 0, 0, 1)) == pytest.approx((1.2, 0.4, 30.0))
