"""Debian packages of an older version: the tested one under another number, or a real one."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

OLDER = "0.0.1-1~older"
CONFIG = "etc/yahboomd/config.toml"


def repacked(
    package: Path, folder: Path, *, config: str = "", version: str = OLDER, breaks: str = ""
) -> Path:
    """The package under another number.

    Args:
        config: The configuration that it has as a file of dpkg's, as versions before had every
            default; empty for none.
        breaks: A command of it that only fails; empty for none.
    """
    tree = folder / "tree"
    subprocess.run(["dpkg-deb", "-R", str(package), str(tree)], check=True)
    control = tree / "DEBIAN/control"
    built = next(
        line.partition(": ")[2] for line in control.read_text().splitlines() if "Version" in line
    )
    for path in (control, tree / "DEBIAN/preinst", tree / "DEBIAN/postinst"):
        if path.exists():
            path.write_text(path.read_text().replace(built, version))
    if breaks:
        program = tree / "opt/yahboomd/bin/yahboomd"
        broken = f'import sys\n\nif sys.argv[1] == "{breaks}":\n    sys.exit("broken")\n'
        program.write_text(program.read_text().replace("import sys\n", broken, 1))
    if config:
        (tree / CONFIG).parent.mkdir(parents=True)
        (tree / CONFIG).write_text(config)
        (tree / "DEBIAN/conffiles").write_text(f"/{CONFIG}\n")
        # It left the file to dpkg.
        (tree / "usr/share/yahboomd/config.toml").unlink()
        postinst = (tree / "DEBIAN/postinst").read_text()
        begin = postinst.index("    # A person's file.")
        end = postinst.index("    # A service that an administrator")
        (tree / "DEBIAN/postinst").write_text(postinst[:begin] + postinst[end:])
    made = folder / f"older-{'full' if config else 'bare'}.deb"
    subprocess.run(
        ["dpkg-deb", "--root-owner-group", "-Znone", "--build", str(tree), str(made)],
        check=True,
        stdout=subprocess.DEVNULL,
    )
    return made


def real_older() -> Path | None:
    """The package of an older commit, which `make system-test OLDER=REVISION` has built."""
    given = os.environ.get("YAHBOOMD_SYSTEM_OLDER", "")
    return Path(given) if given else None
