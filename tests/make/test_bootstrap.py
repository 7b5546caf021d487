"""The work of `make` before anything of yahboomd can be imported."""

from __future__ import annotations

import ast
import os
import re
import stat
import subprocess
import sys
from pathlib import Path

from yahboomd.cli.main import OLDEST

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = ROOT / "make" / "bootstrap.py"


def bootstrap(
    *arguments: str, script: Path = SCRIPT, path: Path | None = None, first: Path | None = None
) -> subprocess.CompletedProcess[str]:
    environ = {**os.environ, "PYTHONPATH": str(path or "")}
    if first is not None:
        environ["PATH"] = f"{first}:{environ['PATH']}"
    return subprocess.run(
        [sys.executable, str(script), *arguments],
        capture_output=True,
        text=True,
        check=False,
        env=environ,
        timeout=60,
    )


def environment(folder: Path, *, pip: int = 0, install: int = 0) -> Path:
    """An environment that exists already; its Python prints its arguments."""
    python = folder / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.write_text(
        "#!/bin/sh\n"
        f'echo "$@" >> "{folder}/asked"\n'
        f'case "$*" in *--version) exit {pip};; *) exit {install};; esac\n'
    )
    python.chmod(python.stat().st_mode | stat.S_IXUSR)
    return folder


def is_one_sentence(text: str) -> bool:
    return text.startswith("yahboomd: ") and text.count("\n") == 1 and "Traceback" not in text


def test_a_python_that_is_too_old_gets_a_sentence_with_the_way_out(tmp_path: Path) -> None:
    script = tmp_path / "bootstrap.py"
    source, replaced = re.subn(r"OLDEST = \(3, 11\)", "OLDEST = (9, 1)", SCRIPT.read_text())
    assert replaced == 1
    script.write_text(source)
    done = bootstrap(str(tmp_path / "venv"), "dev", script=script)
    assert done.returncode == 1
    assert is_one_sentence(done.stderr)
    assert f"this is Python {sys.version_info[0]}.{sys.version_info[1]}" in done.stderr
    assert "needs 9.1 or later" in done.stderr
    assert "make PYTHON=" in done.stderr
    assert "install --user uv" in done.stderr
    assert not (tmp_path / "venv").exists()


def test_a_newer_python_beside_one_that_is_too_old_is_used(tmp_path: Path) -> None:
    script, newer = tmp_path / "bootstrap.py", tmp_path / "bin" / "python9.2"
    script.write_text(SCRIPT.read_text().replace("OLDEST = (3, 11)", "OLDEST = (9, 1)"))
    environment(tmp_path)
    (tmp_path / "bin" / "python").rename(newer)
    newer.write_text(
        f'#!/bin/sh\ncase "$1" in -c) echo {newer};; *) echo "$@" > {tmp_path}/made;; esac\n'
    )
    done = bootstrap(str(tmp_path / "venv"), "dev", script=script, first=newer.parent)
    assert f"{newer} is used" in done.stdout
    assert (tmp_path / "made").read_text().split() == ["-m", "venv", str(tmp_path / "venv")]


def test_the_oldest_python_is_that_of_the_commands() -> None:
    assert f"OLDEST = {OLDEST}" in SCRIPT.read_text()


def test_an_old_python_can_read_the_script_at_all() -> None:
    ast.parse(SCRIPT.read_text(), feature_version=(3, 4))


def test_a_python_without_venv_names_the_package_to_install(tmp_path: Path) -> None:
    # Debian's python3 comes without ensurepip unless python3-venv is installed.
    (tmp_path / "ensurepip.py").write_text("raise ImportError\n")
    done = bootstrap(str(tmp_path / "venv"), "dev", path=tmp_path)
    assert done.returncode == 1
    assert is_one_sentence(done.stderr)
    assert "sudo apt install python3-venv" in done.stderr
    assert not (tmp_path / "venv").exists()


def test_the_package_is_installed_with_what_was_asked_for(tmp_path: Path) -> None:
    folder = environment(tmp_path / "venv")
    done = bootstrap(str(folder), "monitor")
    assert done.returncode == 0, done.stderr
    asked = (folder / "asked").read_text().splitlines()
    assert asked[-1].endswith("install --quiet -e .[monitor]")


def test_packages_that_cannot_be_had_end_in_a_sentence(tmp_path: Path) -> None:
    done = bootstrap(str(environment(tmp_path / "venv", install=1)), "monitor")
    assert done.returncode == 1
    assert is_one_sentence(done.stderr)
    assert "Is there a network?" in done.stderr


def test_an_environment_that_was_left_half_made_is_made_again(tmp_path: Path) -> None:
    folder = environment(tmp_path / "venv", pip=1)
    script = tmp_path / "bootstrap.py"
    # Making one is what `make test` does; here it is enough to see that it would.
    would = "import sys; print('made', sys.argv[1:])"
    script.write_text(SCRIPT.read_text().replace('"-m", "venv"', f'"-c", "{would}"'))
    done = bootstrap(str(folder), "monitor", script=script)
    assert f"made ['{folder}']" in done.stdout
    # Only a former environment is cleared away.
    (folder / "pyvenv.cfg").write_text("")
    done = bootstrap(str(folder), "monitor", script=script)
    assert f"made ['{folder}', '--clear']" in done.stdout


def test_an_environment_that_cannot_be_made_ends_in_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    done = bootstrap(str(tmp_path / "file" / "venv"), "monitor")
    assert done.returncode == 1
    assert "Traceback" not in done.stderr.splitlines()[-1]
    assert done.stderr.splitlines()[-1].startswith("yahboomd: the virtual environment could not")


def test_what_lands_is_checked_by_make_test() -> None:
    assert "make test" in (ROOT / ".ci" / "run").read_text()
    plan = subprocess.run(
        ["make", "-n", "test"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout
    for check in ("ruff check", "ruff format --check", "mypy", "lint-imports", "--check", "pytest"):
        assert check in plan
