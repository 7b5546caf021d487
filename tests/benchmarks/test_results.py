from __future__ import annotations

import math

from benchmarks.results import HEAD, ROOT, Section, number, quantile, store, stored, write_pages


def test_a_quantile_is_one_of_the_values() -> None:
    values = [5.0, 1.0, 4.0, 2.0, 3.0]
    assert quantile(values, 0.5) == 3.0
    assert quantile(values, 0.99) == 5.0
    assert quantile(values, 0.0) == 1.0
    assert math.isnan(quantile([], 0.5))


def test_numbers_have_three_digits_that_count() -> None:
    assert [number(value) for value in (1234.5, 99.96, 12.34, 1.234, 0.01234, 0.0)] == [
        "1234",
        "100",
        "12.3",
        "1.23",
        "0.0123",
        "0",
    ]
    assert number(math.nan) == "-"


def speed() -> Section:
    section = Section(
        name="speed", title="Speed", about="How fast.", how="Somehow.", findings=["It is fast."]
    )
    section.table("In m/s.", ["driver", "m/s"], [["ours", "3"]])
    section.table("Summary.", ["best", "m/s"], [["theirs", "4"]], result=True)
    section.images.append(("speed.png", "Speed over time"))
    return section


def test_a_section_survives_the_store(tmp_path):
    store(speed(), tmp_path)
    assert stored(["absent", "speed"], tmp_path) == [speed()]


def test_results_and_pictures_are_on_one_page_and_all_tables_on_another(tmp_path):
    write_pages([speed()], tmp_path)
    page = (tmp_path / "benchmarks.md").read_text()
    for words in ("## Speed", "How fast.", "- It is fast.", "| theirs | 4 |", "images/speed.png"):
        assert words in page
    assert "(benchmarks/speed.md)" in page
    assert "| ours | 3 |" not in page
    tables = (tmp_path / "benchmarks" / "speed.md").read_text()
    for words in ("# Speed", "Somehow.", "| ours | 3 |", "| theirs | 4 |", "(../benchmarks.md)"):
        assert words in tables


def test_the_page_begins_as_it_would_be_written():
    assert (ROOT / "docs" / "benchmarks.md").read_text().startswith(HEAD)
