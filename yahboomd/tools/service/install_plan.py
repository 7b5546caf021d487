"""Plans an installation: the place of each file, and the fate of existing ones.

This module writes nothing. :mod:`yahboomd.cli.install` carries a plan out.
"""

from __future__ import annotations

import re
import stat
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Literal

import msgspec

from yahboomd.core.errors import Refused

PACKAGED = Path("/opt/yahboomd")
"""The environment of the Debian package; dpkg installs its files."""

UNIT_PROGRAM = "/usr/bin/yahboomd"
"""The program's path in the unit files of the source tree."""

FILES: Mapping[str, str] = {
    "yahboomd.service": "etc/systemd/system/yahboomd.service",
    "yahboomd@.service": "etc/systemd/system/yahboomd@.service",
    "yahboomd-metrics.service": "etc/systemd/system/yahboomd-metrics.service",
    "yahboomd-moves.service": "etc/systemd/system/yahboomd-moves.service",
    "yahboomd-web.service": "etc/systemd/system/yahboomd-web.service",
    "95-yahboomd.rules": "etc/udev/rules.d/95-yahboomd.rules",
    "yahboomd.sysusers.conf": "etc/sysusers.d/yahboomd.conf",
}
"""yahboomd's own files, replaced at each installation: source to place below the root."""

SHARE = "usr/local/share"
"""man and the shells look here for software that an administrator installed."""

FISH_SHARED = "fish/vendor_completions.d/yahboomd.fish"
FISH = "etc/fish/completions/yahboomd.fish"
"""fish looks below /usr/local only if XDG_DATA_DIRS names it, which over SSH it does not."""

CONFIG = "etc/yahboomd/config.toml"
"""A person's file: written once, then kept."""

WEB = "yahboomd-web.service"
"""The page's service, started only on request."""

WEB_LISTEN = "etc/systemd/system/yahboomd-web.service.d/listen.conf"
"""Written if the page shall be reachable from elsewhere; afterwards the person's file."""

FIRST_INSTANCE_PORT = 7449
"""The default of the single service is 7448."""

HIDDEN = ("/home", "/root", "/run/user", "/tmp", "/var/tmp")  # noqa: S108 - named, not used
"""Folders that the service does not see (ProtectHome=, PrivateTmp=)."""

REACH_REMEDY = """\
Install it where every user may read it; PACKAGE is the wheel, or the folder of the source:
  sudo python3 -m venv /opt/yahboomd-venv
  sudo /opt/yahboomd-venv/bin/pip install PACKAGE
  sudo /opt/yahboomd-venv/bin/yahboomd install
or, if Python is older than 3.11, with uv:
  sudo env UV_TOOL_DIR=/opt/uv/tools UV_TOOL_BIN_DIR=/usr/local/bin \\
    UV_PYTHON_INSTALL_DIR=/opt/uv/python uv tool install --python 3.12 PACKAGE
  sudo yahboomd install"""

Fate = Literal["new", "changed", "unchanged", "kept"]


class PlannedFile(msgspec.Struct, frozen=True, kw_only=True):
    """A file that shall be in place.

    Attributes:
        path: Its place, including the root.
        fate: ``new``, ``changed`` (replaces an older one), ``unchanged`` (is right already) or
            ``kept`` (a person's own, left alone).
    """

    path: Path
    text: str
    fate: Fate


def data_text(name: str) -> str:
    """The text of a file that the installation carries, in the wheel or the source tree.

    Raises:
        OSError: The file is missing.
    """
    package = Path(__file__).resolve().parents[2]
    for place in (package / "_data/systemd" / name, package.parent / "systemd" / name):
        if place.is_file():
            return place.read_text(encoding="utf-8")
    raise FileNotFoundError(f"{name} is missing from this installation of yahboomd")


def below(root: Path, place: str) -> Path:
    """A place in the system below a root.

    Raises:
        Refused: A link of that system leads out of the root, such as an absolute one: the file
            would be another system's.
    """
    path = root / place
    if not (there := path.parent.resolve()).is_relative_to(root.resolve()):
        raise Refused(
            f"{path.parent} leads to {there}, outside of {root}. Nothing was changed there.",
            remedy="Make the link relative, or run `yahboomd install` in that system (chroot).",
        )
    return path


def planned_files(root: Path, program: Path, *, packaged: bool) -> list[PlannedFile]:
    """The files of the service itself; none if the Debian package brings them."""
    if packaged:
        return []
    files = [
        _planned(below(root, place), data_text(name).replace(UNIT_PROGRAM, str(program)))
        for name, place in FILES.items()
    ]
    files.append(_planned(below(root, CONFIG), data_text("config.toml"), keep=True))
    return files


def shared_plan(root: Path, texts: Mapping[str, str]) -> list[PlannedFile]:
    """Man pages and completions, which the service does not need.

    Args:
        texts: The files by their paths below a folder ``share``.
    """
    places = {FISH_SHARED: FISH}
    return [
        _planned(below(root, places.get(name, f"{SHARE}/{name}")), text)
        for name, text in texts.items()
    ]


def instance_file(root: Path, name: str, port: str) -> PlannedFile:
    """The configuration of one of several boards.

    Args:
        name: The instance, which is also the robot's namespace.
        port: Its serial port; best a name below ``/dev/serial/by-path``, which stays with the
            socket.
    """
    folder = below(root, CONFIG).parent
    path = folder / f"{name}.toml"
    others = [each for each in sorted(folder.glob("*.toml")) if each != path]
    listen = free_listen_port(each.read_text(encoding="utf-8") for each in others)
    text = (
        f"# The board {name!r}, for yahboomd@{name}.service. Keys left out have their defaults:\n"
        "# yahboomd config reference --toml shows every key.\n"
        "\n"
        "[serial]\n"
        f'port = "{port}"\n'
        "\n"
        "[zenoh]\n"
        f'namespace = "{name}"\n'
        f'listen = ["tcp/127.0.0.1:{listen}"]\n'
    )
    return _planned(path, text, keep=True)


def web_listen_file(root: Path, listen: str) -> PlannedFile:
    """The addition to the page's unit that lets other machines reach it."""
    text = (
        "# Written by `yahboomd install --web --listen`. The links: sudo yahboomd web --show-link\n"
        "[Service]\n"
        f'Environment="WEB_OPTIONS=--listen {listen}"\n'
        "IPAddressDeny=\n"
    )
    return _planned(below(root, WEB_LISTEN), text)


def free_listen_port(configurations: Iterable[str]) -> int:
    """The first port from 7449 on that no other configuration mentions."""
    taken = {int(each) for text in configurations for each in re.findall(r":(\d{4,5})\b", text)}
    port = FIRST_INSTANCE_PORT
    while port in taken:
        port += 1
    return port


def instance_name_is_good(name: str) -> bool:
    """Whether a name can name a unit and a file, and be a key of the bus."""
    return re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name) is not None and name != "config"


def unreachable(paths: Iterable[Path]) -> Path | None:
    """The first path that the service's user cannot read; ``None`` if it can read all."""
    for path in paths:
        # Check both the given path and the one that its links lead to.
        for way in (path, path.resolve()):
            if any(way.is_relative_to(folder) for folder in HIDDEN):
                return path
            for step in (way, *way.parents):
                needed = stat.S_IROTH if step == way else stat.S_IXOTH
                if _mode(step) & needed != needed:
                    return path
    return None


def _mode(path: Path) -> int:
    try:
        return path.stat().st_mode
    except OSError:
        return 0


def _planned(path: Path, text: str, *, keep: bool = False) -> PlannedFile:
    fate: Fate = "new"
    if path.exists():
        same = path.read_bytes() == text.encode()
        fate = "unchanged" if same else "kept" if keep else "changed"
    return PlannedFile(path=path, text=text, fate=fate)
