"""`make system-test`: tests the service under a real systemd, in a Debian container.

Prepares and runs the tests:

- debootstrap and systemd-nspawn, installed by apt if this runs as root;
- a Debian with systemd, made once in ${YAHBOOMD_CACHE:-~/.cache/yahboomd}/system-test;
- the Debian package of this tree, built on the same distribution.

Each run boots that Debian with an overlay in memory, so nothing of a run is left in it.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

TREE = Path(__file__).resolve().parent.parent
INCLUDE = "systemd,systemd-sysv,dbus,udev,init-system-helpers,python3,python3-venv,ca-certificates"
NEEDED = {
    "debootstrap": "debootstrap",
    "systemd-nspawn": "systemd-container",
    "nsenter": "util-linux",
    "dpkg-deb": "dpkg",
}


class Impossible(Exception):
    """This machine cannot run the tests; the message has the reason."""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n", maxsplit=1)[0])
    parser.add_argument("--suite", default="bookworm", help="the Debian release to boot")
    parser.add_argument(
        "--short", action="store_true", help="the main claims only, for every change"
    )
    parser.add_argument(
        "--if-possible", action="store_true", help="end well if this machine cannot do it"
    )
    args, more = parser.parse_known_args()
    try:
        cache = prepare_cache()
        install_tools()
        root = make_root(cache, args.suite)
        package = build_package(TREE, cache / f"packages-{root.name}", root)
    except Impossible as why:
        sys.stderr.write(f"system-test: not run: {why}\n")
        return 0 if args.if_possible else 1
    return subprocess.call(
        [sys.executable, "-m", "pytest", "tests/system", "-q", *more],
        cwd=TREE,
        env={
            **os.environ,
            "YAHBOOMD_SYSTEM_ROOT": str(root),
            "YAHBOOMD_SYSTEM_PACKAGE": str(package),
            "YAHBOOMD_SYSTEM_SHORT": "1" if args.short else "",
        },
    )


def prepare_cache() -> Path:
    given = os.environ.get("YAHBOOMD_CACHE") or "~/.cache/yahboomd"
    cache = Path(given).expanduser().absolute() / "system-test"
    cache.mkdir(parents=True, exist_ok=True)
    return cache


def install_tools() -> None:
    if os.geteuid() != 0:
        raise Impossible("booting a system in a container needs root; use sudo make system-test.")
    missing = sorted({package for tool, package in NEEDED.items() if not shutil.which(tool)})
    if not missing:
        return
    if not shutil.which("apt-get"):
        raise Impossible(f"it needs {', '.join(missing)}, and this machine has no apt.")
    print(f"system-test: installing {', '.join(missing)}", flush=True)
    quiet = {
        "stdout": subprocess.DEVNULL,
        "env": {**os.environ, "DEBIAN_FRONTEND": "noninteractive"},
    }
    subprocess.call(["apt-get", "update", "-qq"], **quiet)
    command = ["apt-get", "install", "-y", "-qq", "--no-install-recommends", *missing]
    if subprocess.call(command, **quiet) != 0:
        raise Impossible(f"apt could not install {', '.join(missing)}; its words are above.")


def make_root(cache: Path, suite: str, *options: str, include: str = INCLUDE) -> Path:
    """A Debian, made once; ``options`` of debootstrap, such as another processor."""
    root = cache / suite
    if root.exists():
        return root
    print(f"system-test: making a Debian {suite} in {root} (two minutes, once)", flush=True)
    # Made beside it and renamed, so that an incomplete one is never used.
    with tempfile.TemporaryDirectory(dir=cache, prefix=f".{suite}-") as folder:
        half = Path(folder) / "root"
        log = cache / f"{suite}.log"
        with log.open("wb") as output:
            status = subprocess.call(
                [
                    "debootstrap",
                    "--variant=minbase",
                    *options,
                    f"--include={include}",
                    suite,
                    str(half),
                ],
                stdout=output,
                stderr=subprocess.STDOUT,
            )
        if status != 0:
            raise Impossible(f"debootstrap failed; see {log}.")
        shutil.rmtree(half / "var/cache/apt/archives", ignore_errors=True)
        (half / "var/cache/apt/archives/partial").mkdir(parents=True)
        half.rename(root)
    return root


def build_package(tree: Path, output: Path, root: Path, *options: str) -> Path:
    """Build a tree's package on the release of a root; ``options`` of packaging/build_deb.py."""
    print("building the Debian package", flush=True)
    shutil.rmtree(output, ignore_errors=True)
    output.mkdir()
    if _release(Path("/")) == _release(root):
        command = [
            sys.executable,
            "packaging/build_deb.py",
            "--quick",
            "--output",
            str(output),
            *options,
        ]
        status = subprocess.call(command, cwd=tree)
    else:
        status = _build_inside(tree, root, output, *options)
    built = sorted(output.glob("*.deb"))
    if status != 0 or not built:
        sys.exit("the package could not be built; see above.")
    return built[0]


def _build_inside(tree: Path, root: Path, output: Path, *options: str) -> int:
    """Build in the booted distribution, with this machine's network and certificates."""
    certificates = "/etc/ssl/certs/ca-certificates.crt"
    trusted = ()
    if Path(certificates).exists():
        trusted = (f"--bind-ro={certificates}:/run/certificates.crt",)
        trusted += ("--setenv=PIP_CERT=/run/certificates.crt",)
    # There is no git in it, which would tell.
    known = subprocess.run(
        [sys.executable, "-m", "setuptools_scm", "--root", str(tree)],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        check=False,
    )
    version = ()
    if known.returncode == 0:
        version = (f"--setenv=SETUPTOOLS_SCM_PRETEND_VERSION={known.stdout.strip()}",)
    return subprocess.call(
        [
            *("systemd-nspawn", "--quiet", "-D", str(root), "--volatile=overlay"),
            *("--register=no", "--keep-unit", "--pipe", "--resolv-conf=copy-host"),
            *(*trusted, *version),
            # The build writes its version into the tree: into a layer of its own.
            *(f"--overlay={tree}::/src", f"--bind={output}:/out"),
            *("python3", "/src/packaging/build_deb.py", "--quick", "--output", "/out"),
            *options,
        ],
        stdin=subprocess.DEVNULL,
    )


def _release(root: Path) -> tuple[str, ...]:
    lines = (root / "etc/os-release").read_text().splitlines()
    return tuple(sorted(line for line in lines if line.startswith(("ID=", "VERSION_ID="))))


if __name__ == "__main__":
    sys.exit(main())
