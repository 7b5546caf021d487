"""`make site`: the Markdown pages as a site in build/site, with every link and anchor checked.

    python make/make_site.py [--published FOLDER]

The pages stay where they are and as the forge shows them. Copies of them get links that fit the
site: to pages on it, and to the project's address for all other files.
"""

from __future__ import annotations

import argparse
import json
import posixpath
import re
import shutil
import subprocess
import sys
import tomllib
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

TREE = Path(__file__).resolve().parent.parent
CONFIG = TREE / "make/site.toml"
OUTSIDE_DOCS = {
    "README.md": "five-minutes.md",
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
    "SECURITY.md": "report-a-hole.md",
    "CODE_OF_CONDUCT.md": "code-of-conduct.md",
    "schemas/README.md": "schemas.md",
    "examples/clients/README.md": "client-contract.md",
    "benchmarks/README.md": "benchmarks/again.md",
}
"""Pages outside docs/, and what they are called on the site."""

LINK = re.compile(r"(\]\()([^)\s]+)(?=\))")
FENCED = re.compile(r"(^ *```.*?^ *```)", re.DOTALL | re.MULTILINE)
PICTURE = re.compile(r"^!\[[^\]]*\]\(([^)\s]+)\)$", re.MULTILINE)
COLOURS = re.compile(r"\x1b\[[0-9;]*m")
CODE = re.compile(r"`[^`]+`")
LIST = re.compile(r"^( *)(?:[-*]|1\.) ")
ITEM = re.compile(r"^( *)(?:[-*]|\d+\.) ")


class SiteError(Exception):
    """The site cannot be built, or a link on it leads nowhere."""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n", maxsplit=1)[0])
    parser.add_argument("--build", type=Path, default=TREE / "build", metavar="FOLDER")
    parser.add_argument(
        "--published", type=Path, metavar="FOLDER", help="also add it as a version to this site"
    )
    args = parser.parse_args()
    site, source = args.build / "site", args.build / "site-source"
    version = version_of(TREE)
    try:
        stage(TREE, source, ref="HEAD" if version == "dev" else f"v{version}")
        _render(source, site)
        check(site)
    except SiteError as error:
        sys.stderr.write(f"site: {error}\n")
        return 1
    pages = sum(1 for _ in site.rglob("*.html"))
    print(f"site: {pages} pages of version {version} in {site}; every link and anchor leads there")
    if args.published:
        publish(site, args.published, version)
        print(f"site: added to {args.published}")
    return 0


def version_of(tree: Path) -> str:
    """The version whose tag is on this commit; else `dev`."""
    call = ("git", "-C", str(tree), "describe", "--tags", "--exact-match", "--match", "v*")
    done = subprocess.run(call, capture_output=True, text=True, check=False)
    return done.stdout.strip().removeprefix("v") if done.returncode == 0 else "dev"


def address_of(tree: Path) -> str:
    """The project's address, from its one place."""
    with (tree / "pyproject.toml").open("rb") as file:
        hooks = tomllib.load(file)["tool"]["hatch"]["metadata"]["hooks"]
    return str(hooks["custom"]["address"])


def pages_of(tree: Path) -> dict[str, str]:
    """Each page's path in the tree, and its path on the site."""
    docs = {
        path.relative_to(tree).as_posix(): path.relative_to(tree / "docs").as_posix()
        for path in sorted((tree / "docs").rglob("*.md"))
    }
    docs = {page: re.sub(r"README\.md$", "index.md", name) for page, name in docs.items()}
    return docs | {page: name for page, name in OUTSIDE_DOCS.items() if (tree / page).exists()}


def stage(tree: Path, source: Path, ref: str) -> None:
    """Write what the generator reads: its configuration, pictures, and pages with other links.

    Raises:
        SiteError: A link leads nowhere, or the navigation has other pages than there are.
    """
    shutil.rmtree(source, ignore_errors=True)
    shutil.copytree(tree / "docs", source / "pages", ignore=shutil.ignore_patterns("*.md"))
    for name in ("pages/site.css", "theme/main.html"):
        (source / name).parent.mkdir(exist_ok=True)
        shutil.copy(tree / "make/site" / Path(name).name, source / name)
    pages, address = pages_of(tree), address_of(tree)
    for page, name in pages.items():
        text = for_site((tree / page).read_text(), page, tree, pages, f"{address}/{{}}/{ref}")
        (source / "pages" / name).parent.mkdir(exist_ok=True)
        (source / "pages" / name).write_text(text)
    config = CONFIG.read_text()
    shown = list(_shown(tomllib.loads(config)["project"]["nav"]))
    if sorted(shown) != sorted(pages.values()):
        differ = sorted(set(shown) ^ set(pages.values())) or "one stands there twice"
        raise SiteError(f"{CONFIG.name}: its `nav` and the pages differ: {differ}")
    owner, _, project = urlsplit(address).path.strip("/").partition("/")
    config = config.replace("PROJECT_ADDRESS", address)
    config = config.replace("SITE_ADDRESS", f"https://{owner.lower()}.github.io/{project}/")
    (source / "zensical.toml").write_text(config)


def for_site(text: str, page: str, tree: Path, pages: dict[str, str], address: str) -> str:
    """A page with the links of the site, and with the blank lines that its Markdown needs.

    Args:
        text: The page, as the forge shows it.
        page: Its path in the tree.
        tree: The project.
        pages: All pages, by their path in the tree.
        address: Where the forge shows files; `{}` stands for `blob` or `tree`.

    Raises:
        SiteError: A link leads to no file.
    """

    def moved(link: re.Match[str]) -> str:
        path, hash_, fragment = link[2].partition("#")
        if not path or "://" in path:
            return link[0]
        target = posixpath.normpath(posixpath.join(posixpath.dirname(page), path))
        if (tree / target).is_dir() and f"{target}/README.md" in pages:
            target = f"{target}/README.md"
        if not (tree / target).exists():
            raise SiteError(f"{page}: there is no {link[2]}")
        if target in pages or target.startswith("docs/images/"):
            there = pages.get(target, target.removeprefix("docs/"))
            path = posixpath.relpath(there, posixpath.dirname(pages[page]) or ".")
        else:
            path = f"{address.format('tree' if (tree / target).is_dir() else 'blob')}/{target}"
        return f"{link[1]}{path}{hash_}{fragment}"

    parts = FENCED.split(_indented(text))
    parts[::2] = [
        # A picture of a whole screen is small on a phone: a tap shows it alone.
        PICTURE.sub(r"[\g<0>](\1)", _spaced(LINK.sub(moved, part)))
        for part in parts[::2]
    ]
    return "\n".join(parts)  # a blank line around each block of code


def _indented(text: str) -> str:
    """What belongs to an item of a list by four spaces; for the forge, two or three will do."""
    lines: list[str] = []
    offset, in_block = 0, False
    for line in text.split("\n"):
        if line.startswith("```"):
            offset, in_block = 0, not in_block
        elif not in_block and (item := re.match(r"(?:[-*]|\d+\.) ", line)):
            offset = len(item[0])
        elif offset and line.startswith(" " * offset):
            line = " " * (4 - offset) + line
        elif line.startswith("#") or (line and lines and not lines[-1]):
            offset = 0
        lines.append(line)
    return "\n".join(lines)


def _spaced(text: str) -> str:
    """Blank lines before lists and tables, and plain bars in code, which the forge does without."""
    lines: list[str] = []
    for line in text.split("\n"):
        before = lines[-1].lstrip() if lines else ""
        starts = LIST.match(line) and not _within_list(lines)
        if line.lstrip().startswith("|"):
            line = CODE.sub(lambda code: code[0].replace(r"\|", "|"), line)
            starts = starts or not before.startswith("|")
        if before and starts:
            lines.append("")
        lines.append(line)
    return "\n".join(lines)


def _within_list(lines: list[str]) -> bool:
    """Whether the paragraph that these lines end with is an item of a list."""
    for line in reversed(lines):
        if not line.strip() or line.startswith("#"):
            return False
        if ITEM.match(line):
            return True
    return False


def _shown(nav: list[Any]) -> list[str]:
    """The pages that a navigation names."""
    found: list[str] = []
    for entry in nav:
        inside = next(iter(entry.values())) if isinstance(entry, dict) else entry
        found += [inside] if isinstance(inside, str) else _shown(inside)
    return found


def _render(source: Path, site: Path) -> None:
    shutil.rmtree(site, ignore_errors=True)
    zensical = (str(Path(sys.executable).parent / "zensical"), "build", "--clean", "--strict")
    done = subprocess.run(
        (*zensical, "-f", str(source / "zensical.toml")),
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode or not (source / "site/index.html").exists():
        said = f"{done.stdout}{done.stderr}".partition("Traceback")[0].strip()
        raise SiteError(f"zensical did not build it:\n{COLOURS.sub('', said)}")
    (source / "site").rename(site)


class Page(HTMLParser):
    """What a page links to, and which anchors it has.

    Attributes:
        links: The values of `href` and `src`, as they are written.
        anchors: The values of `id` and `name`.
    """

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: set[str] = set()
        self.anchors: set[str] = {"", "top"}
        self.feed(text)

    def handle_starttag(self, _tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if name in {"href", "src"} and value is not None:
                self.links.add(value)
            elif name in {"id", "name"} and value:
                self.anchors.add(value)


def check(site: Path) -> None:
    """Follow each link on a built site, of its theme too.

    Raises:
        SiteError: The site lacks the files or anchors of links.
    """
    if broken := broken_links(site):
        raise SiteError("these links lead nowhere:\n  " + "\n  ".join(broken))


def broken_links(site: Path) -> list[str]:
    """The links of a built site to files or anchors that it lacks."""
    pages = {path: Page(path.read_text()) for path in sorted(site.rglob("*.html"))}
    broken = []
    for path, page in pages.items():
        if path.name == "404.html":
            continue  # its links begin at the root of wherever the site is put
        for link in sorted(page.links):
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            target = target / "index.html" if target.is_dir() else target
            fragment = unquote(parts.fragment)
            known = target.exists()
            if known and target in pages:
                known = fragment in pages[target].anchors
            if not known:
                broken.append(f"{path.relative_to(site)}: {link}")
    return broken


def publish(site: Path, published: Path, version: str) -> None:
    """Add a built site to a published one, which lists its versions for the site's own menu.

    The newest release is also `latest`, which the first page leads to; before any release,
    that is `dev`.
    """
    listed = published / "versions.json"
    known = json.loads(listed.read_text()) if listed.exists() else []
    names = {str(each["version"]) for each in known} | {version}
    releases = sorted(names - {"dev"}, key=_order, reverse=True)
    latest = releases[0] if releases else "dev"
    for folder in {version, "latest"} if version == latest else {version}:
        shutil.rmtree(published / folder, ignore_errors=True)
        shutil.copytree(site, published / folder)
    versions = [
        {"version": name, "title": name, "aliases": ["latest"] if name == latest else []}
        for name in (*releases, *(names & {"dev"}))
    ]
    listed.write_text(json.dumps(versions))
    (published / ".nojekyll").touch()
    (published / "index.html").write_text(
        '<!doctype html><meta charset="utf-8"><title>yahboomd</title>'
        '<meta http-equiv="refresh" content="0; url=latest/"><a href="latest/">yahboomd</a>\n'
    )


def _order(version: str) -> list[int]:
    return [int(number) for number in re.findall(r"\d+", version)]


if __name__ == "__main__":
    sys.exit(main())
