"""A file of points: what is driven, and what is refused."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from yahboomd.core.errors import Refused
from yahboomd.tools.robot.path_file import MOST_BYTES, read_points, summary


@pytest.mark.parametrize(
    ("text", "points"),
    [
        ("1,2\n3,4\n", ((1.0, 2.0), (3.0, 4.0))),
        ("x,y,theta\n# a comment\n\n1, 2\n3,4,0.5\n", ((1.0, 2.0), (3.0, 4.0, 0.5))),
        ("\ufeff1,2\r\n3,4\r\n", ((1.0, 2.0), (3.0, 4.0))),
        ("\ufeffx,y\n1,2\n", ((1.0, 2.0),)),
        ("theta_rad,y [m],x (m)\n.5,+2,-1e0\n", ((-1.0, 2.0, 0.5),)),
        ("# x_m,y_m\n1,2\n", ((1.0, 2.0),)),
        ("# x, y in metres\n1,2\n", ((1.0, 2.0),)),
        ('"X","Y"\n"1","2"\n', ((1.0, 2.0),)),
        ("1,2,\n,,\n", ((1.0, 2.0),)),
    ],
)
def test_points_are_read_by_the_names_of_their_columns(
    tmp_path: Path, text: str, points: tuple[tuple[float, ...], ...]
) -> None:
    file = tmp_path / "way.csv"
    file.write_text(text, encoding="utf-8")
    assert read_points(file) == points


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("x,y,v\n0.05,0.0,0.3\n", 1),
        ("# x_m,y_m,v_m_s\n0.05,0.0,0.3\n", 1),
        ("x,y,theta_deg\n0,0,90\n", 1),
        ("x_mm,y_mm\n50,0\n", 1),
        ("x,y,x\n0,0,1\n", 1),
        ("x\n1\n", 1),
        ("x;y\n0;0\n", 1),
        ("O.5,O.5\n1,1\n", 1),
        ("l.0,2\n3,4\n", 1),
        ("1,2\nx,y\n", 2),
        ("x,y\nm,m\n1,2\n", 2),
        ("x,y\n1,2,0.5\n", 2),
        ("# x_m; y_m; right_m; left_m\n0.1; 0.0; 1.1; 1.1\n", 2),
        ("1_0,0\n", 1),
        ("\u0661,0\n", 1),
        ("1,nan\n", 1),
        ("1,1e999\n", 1),
        ("1,2,90\n", 1),
        ("0,5;1,0\n", 1),
        ("0,5,1,0\n", 1),
        ('"0,5","1,0"\n', 1),
        ('"0,5",1\n', 1),
        ("1\n", 1),
        (",1,2\n", 1),
        ("1\t2\n", 1),
    ],
)
def test_a_line_that_is_no_point_is_named_and_nothing_is_driven(
    tmp_path: Path, text: str, line: int
) -> None:
    file = tmp_path / "way.csv"
    file.write_text(text)
    with pytest.raises(Refused, match=f"^{file}, line {line}: .* metres and radians"):
        read_points(file)


@pytest.mark.parametrize(
    ("raw", "words"),
    [
        (b"", "has no points"),
        (b"x,y\n", "has no points"),
        ("1,2\n".encode("utf-16"), "is no UTF-8 text"),
        (b"1" * (MOST_BYTES + 1), "is no path"),
        (b"1" * MOST_BYTES, "is no point"),
    ],
)
def test_a_file_without_a_path_is_refused(tmp_path: Path, raw: bytes, words: str) -> None:
    file = tmp_path / "way.csv"
    file.write_bytes(raw)
    with pytest.raises(Refused, match=words):
        read_points(file)


def test_a_pipe_or_a_device_ends_the_wait(tmp_path: Path) -> None:
    pipe = tmp_path / "way"
    os.mkfifo(pipe)
    with pytest.raises(Refused, match="nothing was written"):
        read_points(pipe, wait_s=0.01)
    with pytest.raises(Refused, match="is no path"):
        read_points(Path("/dev/zero"))
    with pytest.raises(Refused, match="cannot be read: No such file"):
        read_points(tmp_path / "none.csv")


def test_the_summary_has_points_metres_and_headings() -> None:
    assert summary(((0.0, 0.0), (3.0, 4.0))) == "2 points, 5.00 m from the first to the last."
    with_headings = summary(((0.0, 0.0), (0.3, 0.0, 0.3)))
    assert with_headings == "2 points, 0.30 m from the first to the last, with a heading at 1."
