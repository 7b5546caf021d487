"""The contents of the Debian package."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).resolve().parents[2]
PACKAGING = ROOT / "packaging"
LINK = re.compile(r"\]\(([^)#:]+)(?:#[^)]*)?\)")


def build_deb() -> ModuleType:
    spec = importlib.util.spec_from_file_location("build_deb", PACKAGING / "build_deb.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_link_of_a_page_in_the_package_leads_to_a_file_in_the_package() -> None:
    there = {(ROOT / page).resolve() for page in build_deb().documents()}
    pages = [page for page in there if page.suffix == ".md"]
    assert len(pages) > 30
    links = [(page, link) for page in pages for link in LINK.findall(page.read_text())]
    assert len(links) > 50
    broken = [
        (str(page), link) for page, link in links if (page.parent / link).resolve() not in there
    ]
    assert broken == []


def test_man_pages_and_completions_are_where_man_and_the_shells_look() -> None:
    there = set(build_deb().shared())
    assert {
        "man/man1/yahboomd.1",
        "man/man1/yahboomd-stop.1",
        "bash-completion/completions/yahboomd",
        "zsh/vendor-completions/_yahboomd",
        "fish/vendor_completions.d/yahboomd.fish",
    } <= there
    assert not any(name.startswith("zsh/site-functions") for name in there)
