"""Writes the files below a folder ``share``: man pages, and completions for three shells.

``python -m yahboomd.cli.shell.shared_files FOLDER`` writes them. With the name of a command of
another package behind it, it writes the man page of that command alone.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from yahboomd.cli.shell.command_tree import whole
from yahboomd.cli.shell.completions import PLACES, SCRIPTS
from yahboomd.cli.shell.manual import pages


def shared_files(command: str = "") -> dict[str, str]:
    """The text of each file by its path below ``share``; of a package's command its man page."""
    if command:
        page = f"yahboomd-{command}.1"
        return {f"man/man1/{page}": pages(whole(installed=True))[page]}
    top = whole()
    texts = {f"man/man1/{name}": text for name, text in pages(top).items()}
    return texts | {place: SCRIPTS[shell](top) for shell, place in PLACES.items()}


def main(argv: Sequence[str]) -> int:
    """Write every file below the given folder, and remove all others there."""
    folder = Path(argv[0])
    texts = shared_files(*argv[1:])
    for old in [path for path in folder.rglob("*") if path.is_file()]:
        if str(old.relative_to(folder)) not in texts:
            old.unlink()
    for name, text in texts.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
