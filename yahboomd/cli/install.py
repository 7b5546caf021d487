"""``yahboomd install``: installs the service, which starts at boot and with the board."""

from __future__ import annotations

import argparse
import importlib.util
import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import yahboomd
from yahboomd.core.atomic_write import write_atomic
from yahboomd.core.errors import Refused
from yahboomd.core.program import install_command
from yahboomd.tools.metrics.http_listener import Place
from yahboomd.tools.service import install_plan
from yahboomd.tools.service.install_plan import PlannedFile

DESCRIPTION = """\
Install the service: unit, udev rule, system user, a default /etc/yahboomd/config.toml, man pages
and completions. An existing configuration is kept. The service starts now, at each boot, and when
the board is plugged in. Doing it again changes nothing that is in place.
"""

EPILOG = """\
examples:
  yahboomd install --dry-run           print the plan, and do nothing
  sudo yahboomd install                one board
  sudo yahboomd install --web          and the page, for browsers on this machine
  sudo yahboomd install --web --listen 0.0.0.0:8480
                                       and the page, for phones
  sudo yahboomd install --instance front --port /dev/serial/by-path/...
                                       one of several boards, as yahboomd@front

exit status:
  0    everything is in place, and the service runs
  1    the service does not run, or a file cannot be written
  77   it needs root: put sudo in front
  78   the service could not run like this; the message has the reason
"""

UDEV = Path("/run/udev/control")
"""The socket exists while udev runs."""

ALREADY = {"unchanged": "as it is", "kept": "kept, it is yours"}

Runner = Callable[[Sequence[str]], int]
"""Runs a command, and returns its exit status."""


class System(NamedTuple):
    """The paths and programs that an installation works on.

    Attributes:
        root: Replaces ``/``.
        packaged: Whether dpkg installed yahboomd's files.
        live: Whether this is the running system, with systemd as its manager.
    """

    root: Path
    program: Path
    packaged: bool
    live: bool
    run: Runner
    dry: bool

    def ran(self, *command: str) -> bool:
        """Run a command and print it; returns whether it succeeded."""
        words = shlex.join(command)
        if self.dry:
            print(f"  would run    {words}")
            return True
        # Flush, so that the command's output follows ours.
        sys.stdout.flush()
        status = self.run(command)
        print(f"  ran          {words}" + (f"   (status {status})" if status else ""))
        return status == 0


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    add_system_options(parser)
    parser.add_argument(
        "--instance", metavar="NAME", help="one of several boards: its service is yahboomd@NAME"
    )
    parser.add_argument(
        "--port", metavar="PATH", help="serial port of the instance's board, by its socket"
    )

    parser.add_argument(
        "--web", action="store_true", help="start the page too: its service is yahboomd-web"
    )
    parser.add_argument(
        "--listen",
        metavar="ADDRESS:PORT",
        help="for --web: where browsers find the page, such as 0.0.0.0:8480 for phones",
    )


def add_system_options(parser: argparse.ArgumentParser) -> None:
    """Add ``--dry-run`` and ``--root DIR``."""
    parser.add_argument("--dry-run", action="store_true", help="print the plan, and do nothing")
    parser.add_argument(
        "--root",
        metavar="DIR",
        type=Path,
        default=Path("/"),
        help="install into this folder instead, such as the image of another machine; nothing is "
        "started",
    )


def system_of(args: argparse.Namespace) -> System:
    """The system that the shared options describe."""
    prefix = Path(sys.prefix)
    return System(
        root=args.root.absolute(),
        program=prefix / "bin" / "yahboomd",
        packaged=prefix == install_plan.PACKAGED,
        live=args.root == Path("/") and Path("/run/systemd/system").is_dir(),
        run=_run,
        dry=args.dry_run,
    )


def shared_plan(system: System) -> list[install_plan.PlannedFile]:
    """Man pages and completions, unless dpkg installed them."""
    if system.packaged:
        return []
    from yahboomd.cli.shell.shared_files import shared_files

    return install_plan.shared_plan(system.root, shared_files())


def run(args: argparse.Namespace) -> int:
    """Install, or print the plan."""
    return install(
        system_of(args), instance=args.instance, port=args.port, web=args.web, listen=args.listen
    )


def install(
    system: System,
    *,
    instance: str | None = None,
    port: str | None = None,
    web: bool = False,
    listen: str | None = None,
) -> int:
    """Install, or print the plan; returns the exit status."""
    trouble = _trouble(system, instance, port) or _web_trouble(web, listen, instance)
    if trouble:
        return complain(trouble, os.EX_CONFIG)
    files = install_plan.planned_files(system.root, system.program, packaged=system.packaged)
    unit = "yahboomd.service"
    if instance is not None and port is not None:
        files.append(install_plan.instance_file(system.root, instance, port))
        unit = f"yahboomd@{instance}.service"
    if listen is not None:
        files.append(install_plan.web_listen_file(system.root, listen))
    if not system.dry and not _may_write(files, system):
        return complain("this needs root: put sudo in front.", os.EX_NOPERM)
    print(f"Installing {unit}, which runs {system.program}:")
    for file in files:
        _put(file, dry=system.dry)
    _put_shared(shared_plan(system), dry=system.dry)
    if system.live:
        status = _start(system, unit, files)
        return _start_web(system, files, listen) or status if web else status
    offline = ("--root", str(system.root)) if system.root != Path("/") else ()
    if shutil.which("systemctl"):
        system.ran("systemctl", *offline, "enable", unit, *([install_plan.WEB] if web else []))
    print("Nothing is started: systemd does not run this system. The user of the service is made")
    print("at its next boot.")
    return os.EX_OK


def complain(words: str, status: int) -> int:
    """Print an error; returns the status."""
    print(f"yahboomd: {words}", file=sys.stderr)
    return status


def _trouble(system: System, instance: str | None, port: str | None) -> str:
    """The reason why the installation is impossible; empty if it is possible."""
    if instance is None and port is not None:
        return "--port is for --instance; one board's port is serial.port in config.toml."
    if instance is not None:
        if not install_plan.instance_name_is_good(instance):
            return f"--instance takes a name such as front (letters, digits, _), not {instance!r}."
        if port is None:
            return f"--instance {instance} needs its --port. {_ports()}"
        if not port.startswith("/") or '"' in port or "\\" in port:
            return f"--port takes an absolute path, not {port!r}."
    if system.root == Path("/"):
        # Below another root, the program lies in its place once that system runs.
        needed = (system.program, Path(sys.executable), Path(yahboomd.__file__))
        hidden = install_plan.unreachable(needed)
        if hidden is not None:
            return (
                f"the service runs as a user of its own, which cannot read {hidden}.\n"
                f"{install_plan.REACH_REMEDY}"
            )
    return ""


def _web_trouble(web: bool, listen: str | None, instance: str | None) -> str:
    """The reason why the page cannot be installed like this; empty if it can."""
    if not web:
        return "--listen is for --web." if listen is not None else ""
    if instance is not None:
        return "--web is for one board; the page of an instance: docs/web.md."
    if listen is not None and Place.of(listen) is None:
        return f"--listen takes an address and a port such as 0.0.0.0:8480, not {listen!r}."
    if importlib.util.find_spec("starlette") is None:
        return f"the page needs packages that are not installed: {install_command('web')}"
    return ""


def _ports() -> str:
    from yahboomd.core.link.discovery import candidates

    names = [each.by_path or each.path for each in candidates()]
    return f"Ports: {', '.join(names)}." if names else "No USB serial port is plugged in now."


def _may_write(files: list[PlannedFile], system: System) -> bool:
    """Whether every folder can be written or made."""
    if system.live and os.geteuid() != 0:
        return False
    return all(_writable(file.path.parent) for file in files)


def _writable(folder: Path) -> bool:
    while not folder.exists():
        folder = folder.parent
    return os.access(folder, os.W_OK)


def _put(file: PlannedFile, *, dry: bool) -> None:
    if file.fate in ALREADY:
        print(f"  unchanged    {file.path}   ({ALREADY[file.fate]})")
        return
    verb = "write" if file.fate == "new" else "replace"
    if dry:
        print(f"  would {verb:<7}{file.path}")
        return
    _write(file)
    print(f"  {'wrote' if file.fate == 'new' else 'replaced':<13}{file.path}")


def _put_shared(files: list[PlannedFile], *, dry: bool) -> None:
    """Write man pages and completions, and print a line for each folder."""
    for folder in dict.fromkeys(file.path.parent for file in files):
        other = [file for file in files if file.path.parent == folder and file.fate != "unchanged"]
        if not other:
            print(f"  unchanged    {folder}")
        elif not _writable(folder):
            print(f"  left out     {folder}   (it cannot be written)")
        elif dry:
            print(f"  would write  {folder}   (files: {len(other)})")
        else:
            for file in other:
                _write(file)
            print(f"  wrote        {folder}   (files: {len(other)})")


def _write(file: PlannedFile) -> None:
    try:
        file.path.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(file.path, file.text.encode())
    except OSError as error:
        raise Refused(
            f"{file.path} cannot be written: {error.strerror}.",
            remedy="Look at the disk and at the folder; then run the same command again: it writes "
            "the missing files.",
        ) from error


def _start(system: System, unit: str, files: list[PlannedFile]) -> int:
    ready = system.packaged or (
        system.ran("systemd-sysusers", str(system.root / "etc/sysusers.d/yahboomd.conf"))
        and system.ran("systemctl", "daemon-reload")
    )
    from yahboomd.core.protocol.registry import usb_ids

    # A container has no udev.
    if UDEV.exists() and not system.packaged:
        system.ran("udevadm", "control", "--reload")
        # Gives a board that is already plugged in its name.
        for vendor in dict.fromkeys(usb[:4] for usb in usb_ids()):
            match = f"--attr-match=idVendor={vendor}"
            system.ran("udevadm", "trigger", "--subsystem-match=usb", match)
        system.ran("udevadm", "trigger", "--subsystem-match=tty")
    changed = any(file.fate in {"new", "changed"} for file in files)
    started = system.ran("systemctl", "enable", unit) and system.ran(
        "systemctl", "restart" if changed else "start", unit
    )
    name = unit.removesuffix(".service")
    config = f"/etc/yahboomd/{name.partition('@')[2] or 'config'}.toml"
    print(
        f"\nLook at it:     systemctl status {name}\n"
        f"                journalctl -u {name} -f\n"
        f"Configure it:   {config}, then sudo systemctl restart {name}\n"
        f"Stop it:        sudo systemctl stop {name}"
    )
    if not (ready and started):
        return complain(f"{unit} does not run yet; see journalctl -u {name}.", 1)
    return os.EX_OK


def _start_web(system: System, files: list[PlannedFile], listen: str | None) -> int:
    changed = any(file.fate in {"new", "changed"} for file in files)
    started = (not system.packaged or system.ran("systemctl", "daemon-reload")) and (
        system.ran("systemctl", "enable", install_plan.WEB)
        and system.ran("systemctl", "restart" if changed else "start", install_plan.WEB)
    )
    if not started:
        return complain("the page is not served yet; see journalctl -u yahboomd-web.", 1)
    print(
        "\nThe page:       http://127.0.0.1:8480/"
        if listen is None
        else "\nThe page:       sudo yahboomd web --show-link   prints its link and QR code"
    )
    return os.EX_OK


def _run(command: Sequence[str]) -> int:
    try:
        # The commands are fixed here, and found on the administrator's PATH.
        return subprocess.run(list(command), check=False).returncode  # noqa: S603
    except FileNotFoundError:
        return 127
