"""``yahboomd uninstall``: stops the service and removes what ``install`` wrote."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from yahboomd.cli.install import UDEV, System, add_system_options, complain, shared_plan, system_of
from yahboomd.tools.service import install_plan

DESCRIPTION = """\
Stop the service, the wheels first, and remove unit, udev rule, user file, man pages and
completions. The configuration in /etc/yahboomd and the state in /var/lib/yahboomd are kept, and so
is the program itself.
"""

EPILOG = """\
examples:
  yahboomd uninstall --dry-run               print the plan, and do nothing
  sudo yahboomd uninstall                    the service, and everything that install wrote
  sudo yahboomd uninstall --instance front   only yahboomd@front

exit status:
  0    it is gone
  77   it needs root: put sudo in front
  78   it came as a Debian package, or there is no such instance
"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    add_system_options(parser)
    parser.add_argument(
        "--instance", metavar="NAME", help="end only yahboomd@NAME; its configuration is kept"
    )


def run(args: argparse.Namespace) -> int:
    """Uninstall, or print the plan."""
    return uninstall(system_of(args), instance=args.instance)


def uninstall(system: System, *, instance: str | None = None) -> int:
    """Uninstall, or print the plan; returns the exit status."""
    if system.packaged and instance is None:
        return complain(
            "this yahboomd came as a Debian package: sudo apt remove yahboomd.", os.EX_CONFIG
        )
    if instance is not None and not install_plan.instance_name_is_good(instance):
        return complain(f"no instance has the name {instance!r}.", os.EX_CONFIG)
    if not system.dry and system.live and os.geteuid() != 0:
        return complain("this needs root: put sudo in front.", os.EX_NOPERM)
    if instance is not None:
        _end(system, [f"yahboomd@{instance}.service"])
        print(f"Kept: {system.root / 'etc/yahboomd' / f'{instance}.toml'}")
        return os.EX_OK
    _end(system, ["yahboomd.service", *_instances(system.root), *_others(system.root)])
    for place in install_plan.FILES.values():
        _remove(install_plan.below(system.root, place), dry=system.dry)
    if (listen := install_plan.below(system.root, install_plan.WEB_LISTEN)).exists():
        _remove(listen, dry=system.dry)
    for file in shared_plan(system):
        if file.path.exists():
            _remove(file.path, dry=system.dry)
    if system.live:
        system.ran("systemctl", "daemon-reload")
        if UDEV.exists():
            system.ran("udevadm", "control", "--reload")
    print(
        "Kept: /etc/yahboomd, /var/lib/yahboomd* and the user yahboomd. To have them gone too:\n"
        "  sudo rm -r /etc/yahboomd /var/lib/yahboomd*; sudo userdel yahboomd"
    )
    return os.EX_OK


def _end(system: System, units: list[str]) -> None:
    if system.live:
        system.ran("systemctl", "disable", "--now", *units)
    elif system.root != Path("/"):
        system.ran("systemctl", "--root", str(system.root), "disable", *units)


def _instances(root: Path) -> list[str]:
    """The enabled services of single boards."""
    wants = root / "etc/systemd/system/multi-user.target.wants"
    return sorted(link.name for link in wants.glob("yahboomd@*.service"))


def _others(root: Path) -> list[str]:
    """The services of the metrics, the moves and the page, if they are installed."""
    names = ("yahboomd-metrics.service", "yahboomd-moves.service", "yahboomd-web.service")
    return [name for name in names if (root / install_plan.FILES[name]).exists()]


def _remove(path: Path, *, dry: bool) -> None:
    if not path.exists():
        print(f"  not there    {path}")
    elif dry:
        print(f"  would remove {path}")
    else:
        path.unlink()
        print(f"  removed      {path}")
