"""Which tests find faults put in by hand? `make planted-faults TIER=test`, hours for all of them.

tests/planted_faults.toml lists the faults. Each is put into a clone of the last commit, where the
tests of a tier run in this environment up to the first failure. That test runs once more without
the fault: one that fails on this machine anyway has found nothing.
"""

import argparse
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

HERE = Path(__file__).resolve().parent.parent
FAULTS = HERE / "tests" / "planted_faults.toml"
TIERS = {"quick": "not realtime and not nightly", "test": "not nightly", "all": ""}
NOT_THESE = (
    # They read the source, not what it does.
    *("tests/test_house.py", "tests/make/test_planted_faults.py"),
    *(f"tests/{each}" for each in ("interop", "generators", "clients", "browser", "firmware")),
)
FIRST_FAILURE = re.compile(r"^(?:FAILED|ERROR) (\S+?::.*?|\S+)(?: - .*)?$", re.MULTILINE)
TEST_S = 180
"""A fault may make a test wait; the slowest healthy one takes 40 s."""


def faults():
    """The faults of the file, by name."""
    return {fault["name"]: fault for fault in tomllib.loads(FAULTS.read_text())["fault"]}


def planted(fault, source):
    """The source with the fault; None if it does not apply any more."""
    return source.replace(fault["old"], fault["new"]) if source.count(fault["old"]) == 1 else None


def clone(tree):
    """Copy the last commit, with its history: some tests ask git."""
    subprocess.run(["git", "clone", "--quiet", "--shared", HERE, tree], check=True)
    version = "yahboomd/_version.txt"
    if (HERE / version).exists():
        shutil.copy(HERE / version, tree / version)


def first_failure(tree, arguments):
    """Run tests in a tree; return the id of the first that fails, empty if none does."""
    command = [sys.executable, "-m", "pytest", "-q", "-x", "--tb=no", "-p", "no:cacheprovider"]
    done = subprocess.run(
        [*command, f"--timeout={TEST_S}", *arguments],
        cwd=tree,
        # Processes that tests start import the faulty yahboomd, too.
        env={**os.environ, "PYTHONPATH": str(tree), "COLUMNS": "1000"},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
    )
    # 5: no test was selected.
    if done.returncode in {0, 5}:
        return ""
    if done.returncode < 0:
        return f"the tests died of {signal.Signals(-done.returncode).name}"
    failed = FIRST_FAILURE.search(done.stdout)
    return failed[1] if failed else f"pytest ended with {done.returncode}: {done.stdout[-500:]}"


def outcome(fault, tree, arguments):
    """Which test finds a fault, in words; and whether one does."""
    path = tree / fault["file"]
    source = path.read_text()
    changed = planted(fault, source)
    if changed is None:
        return "no longer applies: write it for the code of today", False
    path.write_text(changed)
    try:
        test = first_failure(tree, arguments)
    finally:
        path.write_text(source)
    if not test:
        return "NOT FOUND", False
    if "::" in test and first_failure(tree, [test]):
        return f"unknown: {test} fails without it, too", False
    return test, True


def main():
    """Print a row for each fault."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", help="only these faults")
    parser.add_argument("--tier", choices=TIERS, default="test")
    parser.add_argument("--only", nargs="+", metavar="TESTS", help="only these tests of the tier")
    parser.add_argument("--workers", default="0", help="processes of tests, as pytest -n")
    options = parser.parse_args()
    known = faults()
    if unknown := set(options.names) - set(known):
        parser.error(f"no such fault: {', '.join(sorted(unknown))}")
    arguments = ["-m", TIERS[options.tier], "-n", options.workers, "--dist", "loadgroup"]
    arguments += options.only or [f"--ignore={each}" for each in NOT_THESE]
    # An end by `timeout` or `kill` ends the tests and removes the clone, too.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    missed = 0
    with tempfile.TemporaryDirectory(prefix="planted-") as folder:
        tree = Path(folder) / "yahboomd"
        clone(tree)
        for name in options.names or known:
            words, is_found = outcome(known[name], tree, arguments)
            print(f"{name:36} {options.tier:6} {words}", flush=True)
            missed += not is_found
    sys.exit(f"{missed} of {len(options.names or known)} not found" if missed else 0)


if __name__ == "__main__":
    main()
