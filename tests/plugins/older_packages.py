"""The tested Debian package as one of an older version: under another number."""

from __future__ import annotations

import subprocess
from pathlib import Path

OLDER = "0.0.1-1~older"


def repacked(package: Path, folder: Path, *, version: str = OLDER, breaks: str = "") -> Path:
    """The package under another number.

    Args:
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
    made = folder / "older.deb"
    subprocess.run(
        ["dpkg-deb", "--root-owner-group", "-Znone", "--build", str(tree), str(made)],
        check=True,
        stdout=subprocess.DEVNULL,
    )
    return made
