from __future__ import annotations

import functools
import math

import pytest

from benchmarks.exactness import floor, tables_of_paths, tables_of_records
from benchmarks.formulas import FORMULAS, OURS
from benchmarks.paths import PATHS, TICK_M, TRACK_M, truth
from benchmarks.recorded import DRIVES
from benchmarks.results import Section, Table

HZ = 20


@functools.cache
def filled(fill) -> Section:
    section = Section(name="exactness", title="Exactness", about="Errors.", how="Counted.")
    fill(section, (HZ,))
    return section


def tables(fill, about: str) -> list[Table]:
    """The tables whose titles contain ``about``."""
    return [table for table in filled(fill).tables if about in table.title]


@pytest.mark.parametrize(("fill", "names"), [(tables_of_paths, PATHS), (tables_of_records, DRIVES)])
def test_every_formula_has_an_error_of_position_and_of_heading_on_every_path(fill, names) -> None:
    for quantity in ("position in mm", "heading in degrees"):
        table = tables(fill, quantity)[-1]
        assert set(FORMULAS) <= set(table.header)
        for name, row in zip(names, table.rows, strict=True):
            assert row[0].startswith(name)
            assert len(row) == len(table.header)
            assert all(float(figure) >= 0.0 for figure in row[1:])


@pytest.mark.parametrize("fill", [tables_of_paths, tables_of_records])
def test_our_heading_stays_within_two_ticks_over_the_track(fill) -> None:
    (table,) = tables(fill, "heading in degrees")
    ours = [float(row[table.header.index(OURS)]) for row in table.rows]
    assert 0.0 < max(ours) <= math.degrees(2.0 * TICK_M / TRACK_M)


def test_the_share_of_the_floor_is_our_error_over_it() -> None:
    table = tables(tables_of_paths, "position in mm")[-1]
    for path, row in zip(PATHS.values(), table.rows, strict=True):
        cells = dict(zip(table.header, row, strict=True))
        floor_mm, floor_degrees = floor(truth(path))
        assert float(cells["encoders' floor"]) == pytest.approx(floor_mm, rel=6e-3)
        share = float(cells[OURS]) / floor_mm
        assert float(cells[f"{OURS} / floor"]) == pytest.approx(share, rel=1e-2)
        assert floor_degrees > 0.0
