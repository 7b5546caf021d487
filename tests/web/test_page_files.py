"""The files of the page."""

from __future__ import annotations

import gzip
from pathlib import Path

from yahboomd.web.web_application import page_files


def test_files_are_found_by_their_path_and_nothing_else_is_served(tmp_path: Path) -> None:
    (tmp_path / "icons").mkdir()
    (tmp_path / "index.html").write_text("<p>" + "x" * 1000)
    (tmp_path / "icons" / "a.svg").write_text("<svg/>")
    (tmp_path / "notes.txt").write_text("not a part of the page")
    files = page_files(tmp_path)
    assert set(files) == {"index.html", "icons/a.svg"}
    page = files["index.html"]
    assert gzip.decompress(page.compressed) == page.content
    assert len(page.compressed) < 100
    assert page.kind == "text/html; charset=utf-8"
    # Not smaller.
    assert files["icons/a.svg"].compressed == b""


def test_the_tag_changes_with_the_content(tmp_path: Path) -> None:
    tags = set()
    for text in ("a", "b", "a"):
        (tmp_path / "page.js").write_text(text)
        tags.add(page_files(tmp_path)["page.js"].etag)
    assert len(tags) == 2
