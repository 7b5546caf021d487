from __future__ import annotations

import math

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from prometheus_client.openmetrics.parser import text_string_to_metric_families as parse_openmetrics
from prometheus_client.parser import text_string_to_metric_families as parse_classic

from yahboomd.tools.metrics.exposition import MAX_LABEL, Exposition, wants_openmetrics


def test_the_official_parser_reads_each_kind_with_its_unit_and_meaning() -> None:
    exposition = Exposition()
    exposition.family("line_bytes", "counter", "bytes that came", "bytes").set(7, {"robot": "a"})
    exposition.family("battery_volts", "gauge", "supply", "volts").set(7.25, {"robot": "a"})
    exposition.family("board", "info", "the board").set(1, {"robot": "a", "version": "1.7.3"})
    families = list(parse_openmetrics(exposition.text(openmetrics=True)))
    assert [(f.name, f.type, f.unit, f.documentation) for f in families] == [
        ("line_bytes", "counter", "bytes", "bytes that came"),
        ("battery_volts", "gauge", "volts", "supply"),
        ("board", "info", "", "the board"),
    ]
    assert [(s.name, s.labels, s.value) for f in families for s in f.samples] == [
        ("line_bytes_total", {"robot": "a"}, 7),
        ("battery_volts", {"robot": "a"}, 7.25),
        ("board_info", {"robot": "a", "version": "1.7.3"}, 1),
    ]


def test_the_older_format_has_the_same_series() -> None:
    exposition = Exposition()
    exposition.family("line_bytes", "counter", "bytes that came", "bytes").set(7, {"robot": "a"})
    exposition.family("board", "info", "the board").set(1, {"robot": "a"})
    text = exposition.text(openmetrics=False)
    assert "# TYPE line_bytes_total counter\n" in text
    assert "# TYPE board_info gauge\n" in text
    assert "EOF" not in text
    series = [(s.name, s.value) for f in parse_classic(text) for s in f.samples]
    assert series == [("line_bytes_total", 7), ("board_info", 1)]


@example(robot="\\n\\", meaning='\\n"\\', value=0.0, openmetrics=True)
@example(robot='"\n\\"', meaning="\\n\n", value=0.0, openmetrics=False)
@given(
    robot=st.text(max_size=MAX_LABEL),
    meaning=st.text(max_size=80),
    value=st.floats(),
    openmetrics=st.booleans(),
)
def test_no_text_breaks_the_page(robot: str, meaning: str, value: float, openmetrics: bool) -> None:
    exposition = Exposition()
    exposition.family("speed", "gauge", meaning).set(value, {"robot": robot})
    exposition.family("behind", "gauge", "comes after it").set(1, {})
    text = exposition.text(openmetrics=openmetrics)
    families = list((parse_openmetrics if openmetrics else parse_classic)(text))
    (sample,) = families[0].samples
    assert sample.labels == ({"robot": robot} if robot else {})
    assert sample.value == value or (math.isnan(value) and math.isnan(sample.value))
    assert families[1].name == "behind"


@pytest.mark.parametrize("openmetrics", [True, False])
def test_a_meaning_is_read_as_it_was_written(openmetrics: bool) -> None:
    meaning = 'a back\\nslash, "quotes"\nand a line'
    exposition = Exposition()
    exposition.family("odd", "gauge", meaning).set(1, {})
    text = exposition.text(openmetrics=openmetrics)
    (family,) = (parse_openmetrics if openmetrics else parse_classic)(text)
    assert family.documentation == meaning


def test_a_family_has_the_series_of_all_robots_together() -> None:
    exposition = Exposition()
    for robot in ("a", "b"):
        exposition.family("up", "gauge", "alive").set(1, {"robot": robot})
        exposition.family("volts", "gauge", "supply", "volts").set(7, {"robot": robot})
    lines = [line for line in exposition.text(openmetrics=True).splitlines() if line[0] != "#"]
    assert lines == [
        'up{robot="a"} 1',
        'up{robot="b"} 1',
        'volts{robot="a"} 7',
        'volts{robot="b"} 7',
    ]


def test_a_long_label_is_cut_and_a_family_without_series_is_not_there() -> None:
    exposition = Exposition()
    exposition.family("up", "gauge", "alive").set(1, {"robot": "x" * 10_000})
    exposition.family("empty", "gauge", "nothing")
    text = exposition.text(openmetrics=True)
    assert "x" * MAX_LABEL in text
    assert "x" * (MAX_LABEL + 1) not in text
    assert "empty" not in text


@pytest.mark.parametrize(("name", "unit"), [("Up", ""), ("a b", ""), ("speed", "meters")])
def test_a_name_that_the_format_forbids_is_refused(name: str, unit: str) -> None:
    with pytest.raises(ValueError, match=name):
        Exposition().family(name, "gauge", "", unit)


@pytest.mark.parametrize(
    ("accept", "openmetrics"),
    [
        ("application/openmetrics-text;version=1.0.0,text/plain;version=0.0.4;q=0.5", True),
        ("text/html,*/*", False),
        ("", False),
    ],
)
def test_a_scraper_gets_the_format_that_it_asks_for(accept: str, openmetrics: bool) -> None:
    assert wants_openmetrics(accept) is openmetrics
