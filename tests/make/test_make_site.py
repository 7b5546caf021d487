"""The site of the pages: links that leave it, Markdown that two readers share, versions."""

from __future__ import annotations

import importlib.util
import json
import re
import tomllib
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]
FORGE = "https://forge.test/who/robot/{}/v1.2.0"


def _module() -> ModuleType:
    spec = importlib.util.spec_from_file_location("make_site", ROOT / "make/make_site.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


make_site = _module()


def on_site(text: str, page: str) -> str:
    return str(make_site.for_site(text, page, ROOT, make_site.pages_of(ROOT), FORGE))


@pytest.mark.parametrize(
    ("page", "link", "there"),
    [
        ("docs/bus.md", "safety.md#x", "safety.md#x"),
        ("docs/decisions/README.md", "../safety.md", "../safety.md"),
        ("docs/bus.md", "decisions/", "decisions/index.md"),
        ("docs/bus.md", "../CONTRIBUTING.md#x", "contributing.md#x"),
        ("docs/README.md", "../README.md", "five-minutes.md"),
        ("docs/decisions/README.md", "../README.md", "../index.md"),
        ("README.md", "docs/bus.md", "bus.md"),
        ("README.md", "docs/images/path.png", "images/path.png"),
        ("benchmarks/README.md", "../docs/bus.md", "../bus.md"),
        ("docs/bus.md", "../config.toml", f"{FORGE.format('blob')}/config.toml"),
        ("docs/bus.md", "../examples/", f"{FORGE.format('tree')}/examples"),
        ("docs/bus.md", "#keys", "#keys"),
        ("docs/bus.md", "https://zenoh.io", "https://zenoh.io"),
    ],
)
def test_a_link_leads_to_the_page_on_the_site_or_to_the_file_on_the_forge(
    page: str, link: str, there: str
) -> None:
    assert on_site(f"see [it]({link})", page) == f"see [it]({there})"


def test_a_link_to_no_file_is_refused_with_its_page() -> None:
    with pytest.raises(make_site.SiteError, match=r"docs/bus\.md: there is no none\.md"):
        on_site("[it](none.md)", "docs/bus.md")


def test_a_link_in_a_block_of_code_is_text() -> None:
    block = "```\n[it](none.md)\n```"
    assert block in on_site(block, "docs/bus.md")


def test_a_picture_alone_on_its_line_leads_to_itself() -> None:
    picture = "![a path](images/path.png)"
    assert on_site(picture, "docs/bus.md") == f"[{picture}](images/path.png)"


@pytest.mark.parametrize(
    ("text", "there"),
    [
        ("text\n- one\n  more\n- two", "text\n\n- one\n    more\n- two"),
        ("text\n1. one\n2. two", "text\n\n1. one\n2. two"),
        ("text in\n2026. Then", "text in\n2026. Then"),
        ("text\n| a |\n|---|", "text\n\n| a |\n|---|"),
        (
            "1. one\n\n   | a |\n   |---|\n\ntext\n   more",
            "1. one\n\n    | a |\n    |---|\n\ntext\n   more",
        ),
        (r"| `a \| b` | c |", "| `a | b` | c |"),
    ],
)  # fmt: skip
def test_lists_and_tables_are_such_for_the_sites_markdown_too(text: str, there: str) -> None:
    assert on_site(text, "docs/bus.md") == there


def test_a_block_of_code_in_a_list_stays_in_its_item() -> None:
    text = "1. one:\n   ```\n   $ run\n   ```\n2. two"
    found = on_site(text, "docs/bus.md")
    assert re.findall(r"^ *", found, re.MULTILINE)[2:5] == [" " * 4] * 3


def test_the_navigation_names_each_page_once_and_decisions_last() -> None:
    nav = tomllib.loads((ROOT / "make/site.toml").read_text())["project"]["nav"]
    shown = make_site._shown(nav)
    assert sorted(shown) == sorted(make_site.pages_of(ROOT).values())
    assert shown[0] == "index.md"
    assert "benchmarks.md" in shown[-50:]
    assert shown[-1].startswith("decisions/")


def test_the_first_page_leads_with_its_four_readers() -> None:
    first = (ROOT / "docs/README.md").read_text().partition("\n## ")[0]
    readers = re.findall(r"^- \*\*(.*)\*\*$", first, re.MULTILINE)
    assert readers == ["I have a robot", "I write a program", "I use ROS 2", "I run many"]


def page(folder: Path, name: str, body: str) -> None:
    (folder / name).mkdir(parents=True, exist_ok=True)
    (folder / name / "index.html").write_text(f"<html><body>{body}</body></html>")


def test_links_to_missing_pages_anchors_and_pictures_are_found(tmp_path: Path) -> None:
    page(
        tmp_path, "", '<a href="b/#here">b</a> <a href="https://zenoh.io/x">x</a> <a href="#">t</a>'
    )
    page(tmp_path, "b", '<h2 id="here">b</h2><a href="../">a</a>')
    assert make_site.broken_links(tmp_path) == []
    page(tmp_path, "c", '<a href="../b/#gone"></a><a href="../d/"></a><img src="../no.png">')
    broken = ["../b/#gone", "../d/", "../no.png"]
    assert make_site.broken_links(tmp_path) == [f"c/index.html: {link}" for link in broken]
    with pytest.raises(make_site.SiteError, match="lead nowhere"):
        make_site.check(tmp_path)


def versions(published: Path) -> dict[str, list[str]]:
    listed = json.loads((published / "versions.json").read_text())
    return {each["version"]: each["aliases"] for each in listed}


def test_a_published_site_keeps_its_versions_and_leads_to_the_newest_release(
    tmp_path: Path,
) -> None:
    site, published = tmp_path / "site", tmp_path / "published"
    published.mkdir()
    latest = published / "latest/index.html"
    for version in ("dev", "0.9.0", "0.10.0", "0.9.1", "dev"):
        page(site, "", version)
        make_site.publish(site, published, version)
    assert versions(published) == {"0.10.0": ["latest"], "0.9.1": [], "0.9.0": [], "dev": []}
    assert list(versions(published)) == ["0.10.0", "0.9.1", "0.9.0", "dev"]
    assert "0.10.0" in latest.read_text()
    assert "0.9.0" in (published / "0.9.0/index.html").read_text()
    assert 'url=latest/"' in (published / "index.html").read_text()
