"""Builds and installations for the tests of web clients, made once, into the cache."""

from __future__ import annotations

import fcntl
import hashlib
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

from client_programs import CACHE, EXAMPLES, Built, Missing, needs

TYPESCRIPT = EXAMPLES / "typescript"
GATEWAY = Path(__file__).with_name("gateway")
PLAYWRIGHT = "playwright-core@1.55.0"


def _key(*parts: bytes) -> str:
    return hashlib.sha256(b"\0".join(parts)).hexdigest()[:16]


def _run(what: str, *command: str | Path, cwd: Path) -> None:
    done = subprocess.run(
        list(map(str, command)), cwd=cwd, capture_output=True, text=True, check=False
    )
    if done.returncode:
        lines = (done.stdout + done.stderr).strip().splitlines()
        raise Missing(f"{what}: {' / '.join(lines[-3:])}")


def _once(name: str, key: str, make: Callable[[Path], None]) -> Path:
    """The folder of one state of the sources, which ``make`` has filled once."""
    CACHE.mkdir(parents=True, exist_ok=True)
    with (CACHE / f"build-{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        folder = CACHE / name / key
        if not (folder / ".built").exists():
            shutil.rmtree(CACHE / name, ignore_errors=True)
            folder.mkdir(parents=True)
            make(folder)
            (folder / ".built").touch()
    return folder


def typescript() -> Path:
    """The folder with the bundles of Node's programs and of the page."""
    npm = needs("npm", "it comes with Node")
    sources = sorted(path for path in TYPESCRIPT.iterdir() if path.is_file())

    def make(folder: Path) -> None:
        for path in sources:
            shutil.copy(path, folder)
        _run("npm install", npm, "install", "--no-audit", "--no-fund", cwd=folder)
        _run("the types of the TypeScript example", npm, "run", "check", cwd=folder)
        _run("the bundles of the TypeScript example", npm, "run", "build", cwd=folder)

    return _once("typescript", _key(*(path.read_bytes() for path in sources)), make) / "dist"


def node_programs() -> Built:
    """The TypeScript example in Node."""
    node = needs("node")
    gateway_program()
    dist = typescript()
    return Built(
        [node, str(dist / "robot.mjs")], [node, str(dist / "arc.mjs")], TYPESCRIPT / "arc.ts"
    )


def curl_programs() -> Built:
    """The example with curl."""
    for tool in ("bash", "curl", "jq"):
        needs(tool)
    gateway_program()
    folder = EXAMPLES / "curl"
    return Built([str(folder / "robot.sh")], [str(folder / "arc.sh")], folder / "arc.sh")


def gateway_program() -> str:
    """zenohd with its two web plugins; minutes of compiling."""
    cargo = needs("cargo", "https://rustup.rs")
    sources = (GATEWAY / "Cargo.toml", GATEWAY / "Cargo.lock", GATEWAY / "src" / "main.rs")

    def make(folder: Path) -> None:
        target = CACHE / "gateway-target"
        build = (cargo, "build", "--locked", "--release", "--target-dir", target)
        _run("the gateway", *build, cwd=GATEWAY)
        shutil.copy(target / "release" / "gateway", folder)
        shutil.rmtree(target)  # a gigabyte that only a rebuild would use

    folder = _once("gateway", _key(*(path.read_bytes() for path in sources)), make)
    return str(folder / "gateway")


def playwright() -> Path:
    """Chromium's driver, as a module for Node."""
    npm = needs("npm", "it comes with Node")

    def make(folder: Path) -> None:
        (folder / "package.json").write_text("{}")
        _run("playwright", npm, "install", "--no-audit", "--no-fund", PLAYWRIGHT, cwd=folder)

    folder = _once("playwright", _key(PLAYWRIGHT.encode()), make)
    return folder / "node_modules" / "playwright-core" / "index.js"
