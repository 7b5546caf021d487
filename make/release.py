"""`make release`: everything that a release publishes, built twice, judged and tried, in dist/.

    python make/release.py [--no-deb] [--output FOLDER]

It builds the last commit, in two clones of its own. Nothing is published: docs/release.md is the
list of what a person does before and after.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import shutil
import socket
import subprocess
import sys
import tempfile
import tomllib
import venv
import zipfile
from pathlib import Path

TREE = Path(__file__).resolve().parent.parent
BIN = Path(sys.executable).parent
LINK = re.compile(r"\]\(([^)\s]+)\)")
DRIVE = """
import sys
from yahboomd.client import PoseSample, Robot

with Robot(sys.argv[1]) as robot:
    robot.wait_alive()
    robot.drive(0.2, 0.0, for_s=1.0)
    pose = next(pose for pose in robot.samples(PoseSample) if pose.x > 0.1)
    print(f"it drove {pose.x:.2f} m on the simulated board")
"""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n", maxsplit=1)[0])
    parser.add_argument("--output", type=Path, default=TREE / "dist", metavar="FOLDER")
    parser.add_argument("--no-deb", action="store_true", help="leave the Debian package out")
    args = parser.parse_args()
    if _output("git", "status", "--porcelain"):
        return _fail("there are changes without a commit, and only commits are built.")
    commit = _output("git", "rev-parse", "HEAD")
    address = address_of(TREE)
    tagged = _output("git", "tag", "--points-at", commit)
    if tagged and "/OWNER/" in address:
        return _fail("the address in pyproject.toml is still the placeholder; fill in the owner.")
    no_deb = without_deb(asked=args.no_deb)
    with tempfile.TemporaryDirectory(prefix="yahboomd-release-") as folder:
        built = []
        for name in ("first", "second"):
            print(f"release: the {name} build of {commit[:9]}", flush=True)
            built.append(_build(Path(folder) / name, commit, deb=not no_deb))
        first, second = built
        again = {file.name: sha256(file) for file in second}
        differ = [file.name for file in first if again.get(file.name) != sha256(file)]
        _judge(first, address)
        _drive(Path(folder) / "first/bare", Path(folder))
        shutil.rmtree(args.output, ignore_errors=True)
        args.output.mkdir(parents=True)
        for file in first:
            shutil.copy2(file, args.output)
    lines = [f"{sha256(args.output / file.name)}  {file.name}\n" for file in first]
    (args.output / "SHA256SUMS").write_text("".join(lines))
    print(f"\nrelease: in {args.output}:")
    for line in lines:
        digest, name = line.split()
        print(f"{(args.output / name).stat().st_size:>12,}  {digest}  {name}")
    if no_deb:
        print(f"release: no Debian package: {no_deb}.")
    if "/OWNER/" in address:
        print(f"release: {address} is a placeholder; a tagged commit is refused with it.")
    if differ:
        return _fail(f"NOT the same in two builds: {', '.join(differ)}.")
    print(f"release: two builds are the same, byte for byte: {len(first)} files")
    return 0


def address_of(tree: Path) -> str:
    """The project's address, from its one place."""
    with (tree / "pyproject.toml").open("rb") as file:
        hooks = tomllib.load(file)["tool"]["hatch"]["metadata"]["hooks"]
    return str(hooks["custom"]["address"])


def without_deb(*, asked: bool) -> str:
    """Why there is no Debian package; nothing if there is one."""
    if asked:
        return "left out by --no-deb"
    return "" if shutil.which("dpkg-deb") else "there is no dpkg-deb here"


def sha256(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


def _build(folder: Path, commit: str, *, deb: bool) -> list[Path]:
    """Clone, and build the files of a release; the wheel is installed in `bare` beside them."""
    source, output, bare = folder / "source", folder / "dist", folder / "bare"
    _run("git", "clone", "--quiet", "--no-checkout", str(TREE), str(source))
    _run("git", "-C", str(source), "checkout", "--quiet", "--detach", commit)
    epoch = _output("git", "log", "-1", "--format=%ct", commit)
    # A wheel is built of its sdist, as those do who build from it.
    build = (str(BIN / "python"), "-m", "build", "--outdir", str(output))
    for project in (source, source / "extras/fleet"):
        _run(*build, str(project), quiet=True, SOURCE_DATE_EPOCH=epoch)
    wheel = next(output.glob("yahboomd-*.whl"))
    venv.create(bare, with_pip=True)
    pip = (str(bare / "bin/python"), "-m", "pip", "--disable-pip-version-check", "-q", "install")
    _run(*pip, str(wheel))
    bill = output / f"{'-'.join(wheel.name.split('-')[:2])}.cdx.json"
    _run(
        str(BIN / "cyclonedx-py"), "environment", "--output-reproducible", "--of", "JSON",
        "--pyproject", str(source / "pyproject.toml"), "-o", str(bill), str(bare / "bin/python"),
        quiet=True,
    )  # fmt: skip
    # pyproject.toml has no version to read, as git has it.
    parts = json.loads(bill.read_text())
    parts["metadata"]["component"]["version"] = wheel.name.split("-")[1]
    bill.write_text(json.dumps(parts, indent=2, sort_keys=True) + "\n")
    if deb:
        packer = str(source / "packaging/build_deb.py")
        _run("/usr/bin/python3", packer, "--output", str(output), quiet=True)
    return sorted(output.iterdir())


def _judge(files: list[Path], address: str) -> None:
    print("release: twine, check-wheel-contents, pyroma, the links of the README", flush=True)
    wheels = [file for file in files if file.suffix == ".whl"]
    sdists = [file for file in files if file.name.endswith(".tar.gz")]
    _run(str(BIN / "twine"), "check", "--strict", *map(str, wheels + sdists))
    _run(str(BIN / "check-wheel-contents"), *map(str, wheels))
    wheel, sdist = (
        next(file for file in found if file.name.startswith("yahboomd-"))
        for found in (wheels, sdists)
    )
    # It wants the e-mail of an author; the authors are reached at the project's address.
    _run(str(BIN / "pyroma"), "--min", "10", "--skip-tests", "AuthorEmail", str(sdist))
    with zipfile.ZipFile(wheel) as packed:
        name = next(name for name in packed.namelist() if name.endswith(".dist-info/METADATA"))
        text = packed.read(name).decode()
    links = LINK.findall(text)
    broken = broken_links(links, address, TREE)
    if broken or not links:
        sys.exit(_fail(f"links of the README that lead nowhere: {', '.join(broken) or 'all'}."))
    print(f"release: {len(links)} links of the README are whole")


def broken_links(links: list[str], address: str, tree: Path) -> list[str]:
    """The links that are relative, or whose file at the project's address is not in `tree`."""
    broken = []
    for link in links:
        if not link.startswith(f"{address}/"):
            broken += [] if "://" in link else [link]
            continue
        _, _, path = link.removeprefix(f"{address}/").split("/", maxsplit=2)
        broken += [] if (tree / path.partition("#")[0]).exists() else [link]
    return broken


def _drive(bare: Path, folder: Path) -> None:
    """Drive the simulated robot for a second with what a wheel and its dependencies install."""
    program, board = str(bare / "bin/yahboomd"), folder / "board"
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{free.getsockname()[1]}"
    run = [program, "run", "--port", str(board), "--no-guard"]
    for value in (f'zenoh.listen=["{endpoint}"]', "zenoh.connect=[]"):
        run += ["--set", value]
    run += ["--set", f"estop.latch_file={folder / 'estop'}"]
    quiet = {"cwd": folder, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with (
        subprocess.Popen([program, "simulate", "--link", str(board)], **quiet) as simulator,
        subprocess.Popen(run, **quiet) as daemon,
    ):
        try:
            _run(str(bare / "bin/python"), "-c", DRIVE, endpoint)
        finally:
            daemon.terminate()
            ended = daemon.wait()
            simulator.terminate()
    if ended != 0:
        sys.exit(_fail(f"the daemon ended with status {ended}, not with standing wheels."))


def _run(*command: str, quiet: bool = False, **environ: str) -> None:
    done = subprocess.run(
        command, cwd=TREE, env={**os.environ, **environ}, check=False, text=True,
        stdout=subprocess.PIPE if quiet else None, stderr=subprocess.STDOUT if quiet else None,
    )  # fmt: skip
    if done.returncode != 0:
        print(done.stdout or "", end="", file=sys.stderr)
        sys.exit(_fail(f"{' '.join(command[:4])} failed; its own words are above."))


def _output(*command: str) -> str:
    done = subprocess.run(command, cwd=TREE, check=True, capture_output=True, text=True)
    return done.stdout.strip()


def _fail(words: str) -> int:
    print(f"release: {words}", file=sys.stderr)
    return 1


if __name__ == "__main__":
    sys.exit(main())
