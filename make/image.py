"""`make image`: the container image of Containerfile for each processor, as archives in dist/.

    python make/image.py [--processor amd64] [--base IMAGE] [--output FOLDER]

Builds with buildah, without a daemon; the other processor's by qemu. In each image the simulated
robot is driven and stopped. Without --base, whose registry it would need, the image starts from a
Debian made by debootstrap. Needs root. `podman load -i FILE` takes an archive.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))

import arm
import system_test
from system_test import TREE, Impossible

PROCESSORS = ("amd64", "arm64")
CERTIFICATES = Path("/etc/ssl/certs/ca-certificates.crt")
BUILDAH = ("buildah", "--root", "{cache}/storage", "--runroot", "{cache}/run")

TRY = """
set -e
yahboomd --version
yahboomd simulate --link /tmp/board &
board=$!
trap 'kill $board $daemon 2>/dev/null || true' EXIT
until [ -e /tmp/board ]; do kill -0 $board; sleep 0.1; done
yahboomd run --port /tmp/board --no-guard &
daemon=$!
until yahboomd send --timeout 120 --vx 0.2 --for 2; do kill -0 $daemon; sleep 1; done
yahboomd pose
yahboomd stop --port /tmp/board
kill $daemon
wait $daemon
echo "it drove, stopped and ended with standing wheels"
"""
"""An image is tried beside this machine's other programs: only its own board is stopped."""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n", maxsplit=1)[0])
    parser.add_argument("--processor", choices=PROCESSORS, help="this one only")
    parser.add_argument("--base", default="", help="an image to start from, of a registry")
    parser.add_argument("--suite", default="bookworm", help="the Debian release, without --base")
    parser.add_argument("--output", type=Path, default=TREE / "dist", metavar="FOLDER")
    args = parser.parse_args()
    system_test.NEEDED.update({"buildah": "buildah", "qemu-aarch64-static": "qemu-user-static"})
    args.output.mkdir(parents=True, exist_ok=True)
    try:
        cache = system_test.prepare_cache().parent / "image"
        cache.mkdir(exist_ok=True)
        system_test.install_tools()
        for processor in (args.processor,) if args.processor else PROCESSORS:
            if processor == "arm64":
                arm.run_foreign_programs()
            base = args.base or _base(cache, args.suite, processor)
            archive = _build(cache, base, processor, args.output)
            print(f"image: {archive}: {archive.stat().st_size / 1e6:.0f} MB", flush=True)
    except Impossible as why:
        sys.stderr.write(f"image: not made: {why}\n")
        return 1
    return 0


def _base(cache: Path, suite: str, processor: str) -> str:
    """A small Debian of debootstrap's, as an image."""
    name = f"localhost/debian-{suite}-{processor}"
    if _buildah(cache, "inspect", "--type", "image", name, quiet=True) == 0:
        return name
    folder = cache / processor
    folder.mkdir(exist_ok=True)
    root = system_test.make_root(folder, suite, f"--arch={processor}", include="ca-certificates")
    container = _said(cache, "from", f"--arch={processor}", "scratch")
    try:
        _must(cache, "add", "--quiet", container, str(root), "/")
        _must(cache, "commit", "--quiet", container, name)
    finally:
        _buildah(cache, "rm", container, quiet=True)
    return name


def _build(cache: Path, base: str, processor: str, output: Path) -> Path:
    """Build, try and pack the image."""
    version = subprocess.run(
        [sys.executable, "-m", "yahboomd", "--version"],
        cwd=TREE, check=True, capture_output=True, text=True,
    ).stdout.split()[-1]  # fmt: skip
    name = f"localhost/yahboomd:{version.replace('+', '-')}-{processor}"
    secret = (f"--secret=id=certificates,src={CERTIFICATES}",) if CERTIFICATES.exists() else ()
    print(f"image: building {name} (minutes)", flush=True)
    with tempfile.TemporaryDirectory(prefix="yahboomd-image-") as folder:
        # Of the last commit only.
        packed = subprocess.run(
            ["git", "archive", "HEAD"], cwd=TREE, check=True, capture_output=True
        )
        subprocess.run(["tar", "-x", "-C", folder], input=packed.stdout, check=True)
        _must(
            cache, "build", "--quiet", "--layers", "--isolation=chroot", *secret,
            f"--arch={processor}", f"--build-arg=BASE={base}",
            f"--build-arg=VERSION={version}", "--tag", name, folder,
        )  # fmt: skip
    container = _said(cache, "from", f"--arch={processor}", "--pull-never", name)
    try:
        _must(cache, "run", "--isolation=chroot", container, "--", "sh", "-c", TRY)
    finally:
        _buildah(cache, "rm", container, quiet=True)
    archive = output / f"yahboomd-{version}-image-{processor}.tar"
    archive.unlink(missing_ok=True)
    _must(cache, "push", "--quiet", name, f"oci-archive:{archive}:{name}")
    return archive


def _command(cache: Path, *words: str) -> list[str]:
    return [*(each.format(cache=cache) for each in BUILDAH), *words]


def _buildah(cache: Path, *words: str, quiet: bool = False) -> int:
    output = subprocess.DEVNULL if quiet else None
    return subprocess.call(
        _command(cache, *words), stdin=subprocess.DEVNULL, stdout=output, stderr=output,
        env={**os.environ, "BUILDAH_FORMAT": "oci"},
    )  # fmt: skip


def _must(cache: Path, *words: str) -> None:
    if _buildah(cache, *words) != 0:
        raise Impossible(f"buildah {words[0]} failed; its own words are above.")


def _said(cache: Path, *words: str) -> str:
    done = subprocess.run(_command(cache, *words), check=False, stdout=subprocess.PIPE, text=True)
    if done.returncode != 0:
        raise Impossible(f"buildah {words[0]} failed; its own words are above.")
    return done.stdout.strip()


if __name__ == "__main__":
    sys.exit(main())
