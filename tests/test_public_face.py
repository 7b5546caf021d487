"""What the public sees: address, README on package indexes, forms, workflows, the checklist."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from ruamel.yaml import YAML

ROOT = Path(__file__).resolve().parents[1]
WORKFLOWS = sorted((ROOT / ".github/workflows").glob("*.yml"))
TARGETS = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))


def module(path: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(Path(path).stem, ROOT / path)
    assert spec is not None
    assert spec.loader is not None
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    return loaded


def yaml(path: Path) -> Any:
    return YAML(typ="safe").load(path.read_text())


def texts() -> dict[Path, str]:
    """The project's own files that are text."""
    top = [path for path in ROOT.iterdir() if path.is_file() and path.name != ".git"]
    folders = (".ci", ".github", "docs", "examples", "make", "packaging", "schemas")
    folders += ("extras", "share", "systemd", "tests", "yahboomd", "benchmarks")
    found = {}
    for path in (*top, *(each for name in folders for each in (ROOT / name).rglob("*"))):
        if not path.is_file() or "__pycache__" in path.parts:
            continue
        try:
            found[path.relative_to(ROOT)] = path.read_text()
        except UnicodeDecodeError:
            continue
    return found


def test_the_projects_address_has_one_place() -> None:
    address = module("make/release.py").address_of(ROOT)
    # Without the forge's name, which others' projects share.
    owner_and_name = address.partition("://")[2].partition("/")[2]
    assert re.fullmatch(r"[\w-]+/[\w-]+", owner_and_name)
    copies = {str(path): text.count(owner_and_name) for path, text in texts().items()}
    assert {path: count for path, count in copies.items() if count} == {"pyproject.toml": 1}


def test_every_link_of_the_readme_is_whole_on_a_package_index() -> None:
    release, public = module("make/release.py"), module("packaging/public_metadata.py")
    text, address = (ROOT / "README.md").read_text(), "https://forge.test/who/robot"
    relative = release.broken_links(release.LINK.findall(text), address, ROOT)
    assert len(relative) > 20
    links = release.LINK.findall(public.readme(text, address, "v1.2.0"))
    assert release.broken_links(links, address, ROOT) == []
    assert f"{address}/raw/v1.2.0/docs/images/path.png" in links
    assert f"{address}/blob/v1.2.0/docs/install.md" in links
    assert release.broken_links([f"{address}/blob/v1.2.0/docs/none.md"], address, ROOT) != []


@pytest.mark.parametrize(
    ("version", "ref"),
    [("0.1.0", "v0.1.0"), ("0.1.dev7+g0123abc", "0123abc"), ("0.0", "HEAD")],
)
def test_links_lead_to_the_tag_or_the_commit_of_the_version(version: str, ref: str) -> None:
    assert module("packaging/public_metadata.py").ref_of(version) == ref


@pytest.mark.parametrize("workflow", WORKFLOWS, ids=lambda workflow: workflow.stem)
def test_a_workflow_may_only_read_and_pins_each_action(workflow: Path) -> None:
    parsed = yaml(workflow)
    assert parsed["permissions"] == {"contents": "read"}
    used = re.findall(r"uses: (\S+)", workflow.read_text())
    assert used
    assert all(re.search(r"@v\d+\.\d+\.\d+$", action) for action in used), used
    for line in re.findall(r"run: make ([a-z-]+)", workflow.read_text()):
        assert line in TARGETS
    assert all("timeout-minutes" in job for job in parsed["jobs"].values())


def test_only_the_job_of_the_index_waits_for_a_person_and_nothing_has_a_password() -> None:
    jobs = yaml(ROOT / ".github/workflows/release.yml")["jobs"]
    assert [name for name, job in jobs.items() if "environment" in job] == ["index"]
    assert jobs["index"]["permissions"] == {"id-token": "write"}
    text = (ROOT / ".github/workflows/release.yml").read_text()
    assert set(re.findall(r"secrets\.(\w+)", text)) == {"GITHUB_TOKEN"}
