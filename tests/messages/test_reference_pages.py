"""The generated pages agree with the registries."""

from __future__ import annotations

from pathlib import Path

import pytest

from make.schema_files.reference_pages import PAGES, events_page, status_page
from yahboomd.core.messages.status_fields import FIELDS, REFUSALS
from yahboomd.tools.schemas.event_kinds import EVENTS, KINDS

DOCS = Path(__file__).parents[2] / "docs"


@pytest.mark.parametrize("name", PAGES)
def test_the_committed_page_is_current(name):
    committed = (DOCS / f"{name}.md").read_text(encoding="utf-8")
    assert committed == PAGES[name](), "run `make schemas`"


def test_the_page_of_events_has_a_row_for_every_kind_and_every_field_of_data():
    page = events_page()
    for kind, info in KINDS.items():
        assert f"| `{kind}` | {', '.join(info.severities)} | {info.when} |" in page
    for info in KINDS.values():
        fields = info.data.__struct_fields__ if info.data else ()
        assert all(f"| `{field}` | " in page for field in fields)
    assert all(f"### {name}\n" in page for name in EVENTS)


def test_the_page_of_the_status_has_a_row_for_every_counter_and_fact():
    page = status_page()
    rows = [line for line in page.splitlines() if line.startswith("| `")]
    named = [field for field in FIELDS if field.group != "command" or field.name not in REFUSALS]
    assert len(rows) == len(named) + len(REFUSALS)
    for field in named:
        row = next(row for row in rows if row.startswith(f"| `{field.name}` | {field.kind} |"))
        assert len(row.strip("|").split("|")) == 4


@pytest.mark.parametrize("name", PAGES)
def test_links_within_a_page_have_a_target(name):
    page = PAGES[name]()
    for link in page.split("](#")[1:]:
        assert link.partition(")")[0] in {
            line.removeprefix("### ").lower() for line in page.splitlines()
        }
