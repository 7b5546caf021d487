"""The files of the page: read and compressed once, and looked up by name only."""

from __future__ import annotations

import gzip
import hashlib
from collections.abc import Mapping
from pathlib import Path

import msgspec

FOLDER = Path(__file__).with_name("page")

TYPES: Mapping[str, str] = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".svg": "image/svg+xml",
    ".png": "image/png",
    ".webmanifest": "application/manifest+json",
}
"""The content types of served files, by suffix."""


class PageFile(msgspec.Struct, frozen=True, kw_only=True):
    """A file of the page.

    Attributes:
        compressed: The content with gzip; empty if that is not smaller.
        etag: Changes with the content.
    """

    content: bytes
    compressed: bytes
    kind: str
    etag: str


def page_files(folder: Path = FOLDER) -> dict[str, PageFile]:
    """Every file of the page, by its path below the folder."""
    return {
        path.relative_to(folder).as_posix(): _file(path)
        for path in sorted(folder.rglob("*"))
        if path.suffix in TYPES and path.is_file()
    }


def _file(path: Path) -> PageFile:
    content = path.read_bytes()
    compressed = gzip.compress(content, mtime=0)
    return PageFile(
        content=content,
        compressed=compressed if len(compressed) < len(content) else b"",
        kind=TYPES[path.suffix],
        etag=f'"{hashlib.sha256(content).hexdigest()[:20]}"',
    )
