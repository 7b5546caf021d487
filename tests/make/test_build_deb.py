"""The contents of the Debian package."""

from __future__ import annotations

import importlib.util
import os
import re
import shutil
import subprocess
import tomllib
from pathlib import Path
from types import ModuleType

import pytest
from packaging.requirements import Requirement

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


def test_the_list_of_a_bundled_package_has_no_file_of_the_building_machine(tmp_path: Path) -> None:
    info = tmp_path / "idna-3.dist-info"
    info.mkdir()
    (tmp_path / "idna.py").touch()
    kept = "idna.py,sha256=aa,0\nidna-3.dist-info/RECORD,,\n"
    scripts = "../../bin/idna,sha256=bb,227\nidna-3.dist-info/direct_url.json,sha256=cc,60\n"
    (info / "RECORD").write_text(scripts + kept)
    build_deb().list_what_is_packed(tmp_path)
    assert (info / "RECORD").read_text() == kept


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


@pytest.mark.skipif(not shutil.which("dpkg"), reason="this is no Debian")
@pytest.mark.parametrize(
    ("installed", "latch", "refused"),
    [
        ("0.2-1~debian12", "yahboomd/estop", True),
        ("0.2-1~debian12", "yahboomd-front/estop.bot1@%2Fdev%2FttyUSB0", True),
        ("0.2-1~debian12", "yahboomd/daemon.sock", False),
        ("0.1~dev7+g0123abc-1~debian12", "yahboomd/estop", False),
        ("0.1-1~debian12", "yahboomd/estop", False),
    ],
)
def test_an_older_package_is_refused_while_the_emergency_stop_is_engaged(
    tmp_path: Path, installed: str, latch: str, refused: bool
) -> None:
    script, file = tmp_path / "preinst", tmp_path / "run" / latch
    script.write_text((PACKAGING / "preinst").read_text().replace("@VERSION@", "0.1-1~debian12"))
    file.parent.mkdir(parents=True)
    file.write_text("")
    done = subprocess.run(
        ["sh", str(script), "upgrade", installed],
        env={**os.environ, "DPKG_ROOT": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == refused
    assert (str(file) in done.stderr) == refused
    assert ("yahboomd stop --release" in done.stderr) == refused


def test_the_pinned_packages_are_those_that_the_project_asks_for() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    wanted = [*project["dependencies"], *extras["monitor"], *extras["web"]]
    pinned = [
        Requirement(line.removesuffix("\\"))
        for line in (PACKAGING / "bundled.txt").read_text().splitlines()
        if line[:1].isalpha()
    ]
    for python in ("3.11", "3.12", "3.13", "3.14"):
        environment = {"python_version": python, "python_full_version": f"{python}.0"}
        there = {
            each.name: next(iter(each.specifier)).version
            for each in pinned
            if each.marker is None or each.marker.evaluate(environment)
        }
        for each in map(Requirement, wanted):
            if each.marker is None or each.marker.evaluate(environment):
                assert each.specifier.contains(there[each.name]), each


def test_pip_takes_the_wheels_of_the_other_processor() -> None:
    options = build_deb()._wheels_for("arm64", (3, 11))
    assert "--platform=manylinux2014_aarch64" in options
    assert "--platform=manylinux_2_17_aarch64" in options
    assert not [each for each in options if "x86_64" in each]
    assert {"--abi=cp311", "--abi=abi3", "--abi=none", "--python-version=3.11"} <= set(options)


@pytest.mark.skipif(not shutil.which("lintian"), reason="there is no lintian on this machine")
def test_lintian_judges_our_own_files_alone(tmp_path: Path) -> None:
    site = tmp_path / "stage/opt/yahboomd/lib/python3.11/site-packages"
    for name in ("yahboomd", "numpy", "yahboomd-1.dist-info"):
        (site / name).mkdir(parents=True)
    control = tmp_path / "stage/DEBIAN/control"
    control.parent.mkdir()
    control.write_text("Package: yahboomd\nVersion: 1\n")
    with pytest.raises(SystemExit):
        build_deb()._judge(tmp_path / "stage", tmp_path / "ours.deb")
    assert sorted(each.name for each in site.iterdir()) == ["yahboomd", "yahboomd-1.dist-info"]
