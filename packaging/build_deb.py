"""Builds the Debian package, for the distribution that this runs on.

    python3 packaging/build_deb.py [--output FOLDER] [--architecture arm64]

The package carries its dependencies, the versions of bundled.txt, in a virtual environment under
/opt/yahboomd, made for the distribution's own Python. It is assembled file by file rather than
copied from a venv, so that it contains no path of the building machine. Needs dpkg-deb, and
python3-venv of the distribution.
"""

from __future__ import annotations

import argparse
import gzip
import hashlib
import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
TREE = HERE.parent
PYTHON = "/usr/bin/python3"
HOME = "opt/yahboomd"
WHEELS = {"amd64": "x86_64", "arm64": "aarch64"}
"""The processors for which all bundled packages have wheels, and the wheels' name for each."""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n", maxsplit=1)[0])
    parser.add_argument("--output", type=Path, default=TREE / "dist", metavar="FOLDER")
    parser.add_argument(
        "--quick", action="store_true", help="only to try it: not compressed, and not judged"
    )
    parser.add_argument(
        "--architecture",
        choices=sorted(WHEELS),
        default=_output("dpkg", "--print-architecture") if shutil.which("dpkg") else None,
        help="the processor it is for (default: this machine's)",
    )
    args = parser.parse_args()
    system = _os_release()
    python = _python_version()
    name = f"{system['ID']}{system.get('VERSION_ID', '')}"
    pretty = system.get("PRETTY_NAME", name)
    if python < (3, 11):
        return _fail(
            f"{pretty} has Python {_dotted(python)}, and yahboomd needs 3.11 or later: no package "
            "can be built for it. See docs/install.md for the way with uv."
        )
    if not shutil.which("dpkg-deb"):
        return _fail("this needs dpkg-deb, of Debian or Ubuntu.")
    with tempfile.TemporaryDirectory(prefix="yahboomd-deb-") as folder:
        work = Path(folder)
        stage = work / "stage"
        # A restrictive umask must not make a package unreadable.
        os.umask(0o022)
        version = _environment(work, stage, python, args.architecture)
        # For dpkg a development version, such as 0.1.dev7, comes before its release.
        version = re.sub(r"\.?(dev|rc|a|b)(?=\d)", r"~\1", version, count=1) + f"-1~{name}"
        _files(stage, version, pretty)
        _control(stage, version, args.architecture, python, pretty)
        args.output.mkdir(parents=True, exist_ok=True)
        package = args.output / f"yahboomd_{version}_{args.architecture}.deb"
        packed = "-Znone" if args.quick else "-Zxz"
        _run("dpkg-deb", "--root-owner-group", packed, "--build", str(stage), str(package))
        if shutil.which("lintian") and not args.quick:
            _judge(stage, work / "ours.deb")
    print(
        f"{package}\n"
        f"built for {pretty} ({args.architecture}, Python {_dotted(python)}); "
        f"{package.stat().st_size / 1e6:.1f} MB\n"
        f"install it there: sudo apt install ./{package.name}   (in {package.parent})"
    )
    return 0


def _judge(stage: Path, package: Path) -> None:
    """Ask lintian about our own files: what others packed into their wheels is theirs."""
    for folder in stage.glob(f"{HOME}/lib/python*/site-packages/*"):
        if not folder.name.startswith("yahboomd"):
            shutil.rmtree(folder) if folder.is_dir() else folder.unlink()
    _sums(stage)
    _run("dpkg-deb", "--root-owner-group", "--build", str(stage), str(package))
    _run("lintian", "--fail-on", "error,warning", "--allow-root", str(package))


def _environment(work: Path, stage: Path, python: tuple[int, int], architecture: str) -> str:
    """The virtual environment; returns yahboomd's version."""
    tools = work / "tools"
    if subprocess.call([PYTHON, "-m", "venv", str(tools)]) != 0:
        raise SystemExit(_fail("no virtual environment: sudo apt install python3-venv."))
    pip = [str(tools / "bin/pip"), "--disable-pip-version-check", "--quiet"]
    _run(*pip, "wheel", "--no-deps", "--wheel-dir", str(work), str(TREE))
    wheel = next(work.glob("yahboomd-*.whl"))
    site = stage / HOME / f"lib/python{_dotted(python)}/site-packages"
    pinned = ["--require-hashes", "--only-binary=:all:", "-r", str(HERE / "bundled.txt")]
    for what in ([*pinned, *_wheels_for(architecture, python)], [str(wheel)]):
        _run(*pip, "install", "--no-deps", "--no-compile", "--target", str(site), *what)
        # These scripts start the build machine's Python; the needed one is written below.
        shutil.rmtree(site / "bin", ignore_errors=True)
        # Man pages and completions go to the folders of man and the shells.
        shutil.rmtree(site / "share", ignore_errors=True)
    for leftover in site.rglob("direct_url.json"):
        # It contains the folder in which the wheel was built.
        leftover.unlink()
    list_what_is_packed(site)
    for path in site.rglob("*"):
        # Modules are imported, not run: pip leaves some executable, their authors some with #!.
        path.chmod(0o755 if path.is_dir() else 0o644)
        if path.suffix == ".py" and path.read_bytes().startswith(b"#!"):
            path.write_bytes(b"#" + path.read_bytes()[2:])
    if strip := shutil.which(f"{WHEELS[architecture]}-linux-gnu-strip"):
        # Libraries inside a wheel were patched, and cannot be loaded once stripped.
        ours = [each for each in site.rglob("*.so") if not each.parent.name.endswith(".libs")]
        _run(strip, "--strip-unneeded", *map(str, sorted(ours)))
    programs = stage / HOME / "bin"
    programs.mkdir()
    (programs / "python3").symlink_to(f"/usr/bin/python{_dotted(python)}")
    (stage / HOME / "pyvenv.cfg").write_text(
        f"home = /usr/bin\ninclude-system-site-packages = false\nversion = {_dotted(python)}\n"
    )
    _write(
        programs / "yahboomd",
        # -I: neither the caller's folder nor the environment affects the imports.
        "#!/opt/yahboomd/bin/python3 -I\n"
        "import sys\n\nfrom yahboomd.cli.main import main\n\nsys.exit(main())\n",
        executable=True,
    )
    return wheel.name.split("-")[1]


def _wheels_for(architecture: str, python: tuple[int, int]) -> list[str]:
    """Options by which pip takes the wheels of a processor, whichever this one is."""
    newest = int(platform.libc_ver()[1].split(".")[1])
    machine = WHEELS[architecture]
    platforms = [f"manylinux_2_{libc}_{machine}" for libc in range(newest, 16, -1)]
    platforms.append(f"manylinux2014_{machine}")
    interpreter = f"cp{python[0]}{python[1]}"
    return [
        *(f"--platform={each}" for each in platforms),
        *(f"--abi={each}" for each in (interpreter, "abi3", "none")),
        *("--implementation=cp", f"--python-version={_dotted(python)}"),
    ]


def list_what_is_packed(site: Path) -> None:
    """Take files that are gone out of each list of installed files.

    They contained folders of the build, so their sums would make each package another one.
    """
    for record in site.glob("*.dist-info/RECORD"):
        lines = record.read_text().splitlines(keepends=True)
        kept = [line for line in lines if (site / line.rsplit(",", 2)[0].strip('"')).exists()]
        record.write_text("".join(kept))


def documents() -> list[Path]:
    """The pages and the files they link to, as paths in the source; the package keeps them."""
    pages = ["README.md", "CONTRIBUTING.md", "CHANGELOG.md", "LICENSE", "config.toml"]
    pages += ["SECURITY.md", "CODE_OF_CONDUCT.md"]
    folders = ("docs", "examples", "schemas")
    found = [path for folder in folders for path in (TREE / folder).rglob("*") if path.is_file()]
    return [Path(page) for page in pages] + sorted(path.relative_to(TREE) for path in found)


def shared() -> dict[str, str]:
    """Man pages and completions by their places below /usr/share."""
    texts = {
        str(path.relative_to(TREE / "share")): path.read_text()
        for path in sorted((TREE / "share").rglob("*"))
        if path.is_file()
    }
    # Debian's zsh looks for packages' completions in a folder of its own.
    texts["zsh/vendor-completions/_yahboomd"] = texts.pop("zsh/site-functions/_yahboomd")
    return texts


def _files(stage: Path, version: str, pretty: str) -> None:
    units = stage / "usr/lib/systemd/system"
    for name in sorted(path.name for path in (TREE / "systemd").glob("*.service")):
        _write(units / name, (TREE / "systemd" / name).read_text())
    _write(
        stage / "usr/lib/udev/rules.d/95-yahboomd.rules",
        (TREE / "systemd/95-yahboomd.rules").read_text(),
    )
    _write(
        stage / "usr/lib/sysusers.d/yahboomd.conf",
        (TREE / "systemd/yahboomd.sysusers.conf").read_text(),
    )
    # No conffile: dpkg would ask about it at each update that changes it. postinst copies it.
    _write(stage / "usr/share/yahboomd/config.toml", (TREE / "systemd/config.toml").read_text())
    (stage / "usr/bin").mkdir(parents=True)
    (stage / "usr/bin/yahboomd").symlink_to(f"/{HOME}/bin/yahboomd")
    doc = stage / "usr/share/doc/yahboomd"
    _write(doc / "copyright", (HERE / "copyright").read_text())
    for page in documents():
        target = doc / page
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(TREE / page, target)
    stamp = _output("date", "-R", "-u", "-d", f"@{_epoch()}")
    _gzip(
        doc / "changelog.Debian.gz",
        f"yahboomd ({version}) unstable; urgency=medium\n\n"
        f"  * Built for {pretty}.\n"
        f"  * What is new: CHANGELOG.md of the source.\n\n"
        f" -- {_maintainer()}  {stamp}\n",
    )
    for name, text in shared().items():
        if name.startswith("man/"):
            _gzip(stage / "usr/share" / f"{name}.gz", text)
        else:
            _write(stage / "usr/share" / name, text)
    _write(
        stage / "usr/share/lintian/overrides/yahboomd",
        (HERE / "lintian-overrides").read_text(),
    )


def _control(
    stage: Path, version: str, architecture: str, python: tuple[int, int], pretty: str
) -> None:
    folder = stage / "DEBIAN"
    size = sum(path.stat().st_size for path in stage.rglob("*") if path.is_file()) // 1024
    _write(
        folder / "control",
        f"Package: yahboomd\n"
        f"Version: {version}\n"
        f"Architecture: {architecture}\n"
        f"Maintainer: {_maintainer()}\n"
        f"Installed-Size: {size}\n"
        f"Depends: libc6, libgcc-s1, python3, python{_dotted(python)}, systemd, udev\n"
        f"Section: electronics\n"
        f"Priority: optional\n"
        f"Description: daemon for Yahboom encoder motor driver boards\n"
        f" Owns the serial port of a 4-channel board, drives its wheels from velocity\n"
        f" commands on a Zenoh bus, and publishes pose, twist, wheels and battery.\n"
        f" Starts at boot and when the board is plugged in, and stops the wheels\n"
        f" whatever fails.\n"
        f" .\n"
        f" Built for {pretty}, Python {_dotted(python)}.\n",
    )
    for name in ("preinst", "postinst", "prerm", "postrm"):
        text = (HERE / name).read_text().replace("@VERSION@", version)
        _write(folder / name, text, executable=True)
    _sums(stage)


def _sums(stage: Path) -> None:
    sums = [
        f"{hashlib.md5(path.read_bytes(), usedforsecurity=False).hexdigest()}  "
        f"{path.relative_to(stage)}\n"
        for path in sorted(stage.rglob("*"))
        if path.is_file()
        and not path.is_symlink()
        and path.parts[len(stage.parts)] not in {"DEBIAN", "etc"}
    ]
    _write(stage / "DEBIAN/md5sums", "".join(sums))


def _os_release() -> dict[str, str]:
    lines = Path("/etc/os-release").read_text().splitlines()
    return {key: value.strip('"') for key, _, value in (line.partition("=") for line in lines)}


def _python_version() -> tuple[int, int]:
    words = _output(PYTHON, "-c", "import sys; print(*sys.version_info[:2])").split()
    return int(words[0]), int(words[1])


def _maintainer() -> str:
    name = os.environ.get("DEBFULLNAME", "yahboomd")
    mail = os.environ.get("DEBEMAIL", "yahboomd@packages.invalid")
    return f"{name} <{mail}>"


def _epoch() -> str:
    """The time of the source, so that the same tree makes the same package."""
    if given := os.environ.get("SOURCE_DATE_EPOCH"):
        return given
    if not shutil.which("git"):
        return "0"
    found = subprocess.run(
        ["git", "-C", str(TREE), "log", "-1", "--format=%ct"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    return found.stdout.strip() or "0"


def _dotted(version: tuple[int, int]) -> str:
    return f"{version[0]}.{version[1]}"


def _write(path: Path, text: str, *, executable: bool = False) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    path.chmod(0o755 if executable else 0o644)


def _gzip(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(gzip.compress(text.encode(), compresslevel=9, mtime=0))


def _run(*command: str) -> None:
    environ = {**os.environ, "SOURCE_DATE_EPOCH": _epoch()}
    if subprocess.call(list(command), env=environ) != 0:
        raise SystemExit(_fail(f"{' '.join(command[:4])} failed; its own words are above."))


def _output(*command: str) -> str:
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


def _fail(words: str) -> int:
    print(f"make deb: {words}", file=sys.stderr)
    return 1


if __name__ == "__main__":
    sys.exit(main())
