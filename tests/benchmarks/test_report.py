from __future__ import annotations

import math

from benchmarks.report import Section, markdown, number, page, quantile, store, stored


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


def test_a_section_survives_the_store_and_stands_on_the_page(tmp_path) -> None:
    section = Section(name="speed", title="Speed", how="Somehow.", findings=["It is fast."])
    section.table("In m/s.", ["who", "m/s"], [["we", "3"]])
    section.images.append(("speed.png", "Speed over time"))
    store(section, tmp_path)
    (found,) = stored(["absent", "speed"], tmp_path)
    assert found == section
    text = page([found])
    for words in ("## Speed", "- It is fast.", "| who | m/s |", "| we | 3 |", "images/speed.png"):
        assert words in text
    assert markdown(section) in text
