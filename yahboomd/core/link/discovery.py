"""Finds the board's port: by its udev name, or as the only CH340 on USB; of several by listening.

It also explains why there is none: the device may be on USB without a tty (some Jetson kernels lack
the ch341 driver), or brltty may have taken it.
"""

from __future__ import annotations

import os
from collections.abc import Awaitable, Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
from serial.tools import list_ports

from yahboomd.core.errors import BoardError, BoardSilent, ConfigError, LinkError, PortMissing
from yahboomd.core.protocol.registry import DIALECTS, usb_ids
from yahboomd.core.protocol.registry import identify as recognise

if TYPE_CHECKING:
    from yahboomd.core.clock import Clock
    from yahboomd.core.link.line import Line
    from yahboomd.core.link.port import Port

UDEV_NAME = "/dev/yahboom_driver"

IS_ONE = "is a board"
NAME_IT = "Name the one to use: --port PATH, or serial.port in config.toml."


class Candidate(msgspec.Struct, frozen=True, kw_only=True):
    """A serial port that the system has.

    Attributes:
        path: The device.
        description: Its name in the system.
        usb: Vendor and product, such as ``1a86:7523``.
        is_ch340: Whether these are a board's.
        by_path: A name that stays with the USB socket, if there is one.
    """

    path: str
    description: str
    usb: str = ""
    is_ch340: bool
    by_path: str | None


def candidates() -> tuple[Candidate, ...]:
    """The serial ports of this machine that could be a board, the likely ones first."""
    known = usb_ids()
    found = [
        Candidate(
            path=port.device,
            description=port.description or "",
            usb=usb,
            is_ch340=usb in known,
            by_path=_by_path(port.device),
        )
        for port in list_ports.comports()
        if port.vid is not None and (usb := f"{port.vid:04x}:{port.pid:04x}")
    ]
    ranks = {usb: rank for rank, usb in enumerate(known)}
    return tuple(sorted(found, key=lambda each: (ranks.get(each.usb, len(ranks)), each.path)))


async def find(
    configured: str,
    found: Sequence[Candidate],
    open_it: Callable[[str], Awaitable[Port]],
    clock: Clock,
) -> tuple[str, str]:
    """The port to open, and a sentence about the others if several could be the board.

    They are listened to first. A board that reports by itself is taken, and nothing is sent to
    any. Else the silent ones of the likelier USB id are stopped and asked, and those of the next
    id only if none of these is a board or held by another process.

    Args:
        configured: ``serial.port``; empty to search.

    Raises:
        PortMissing: Nothing looks like a board.
        BoardSilent: Several do, and none answers like one.
        ConfigError: Several answer, and only a person can choose.
    """
    likely = [each for each in found if each.is_ch340]
    if configured or len(likely) < 2:
        return choose(configured, found), ""
    # Slow to import, and a stop on the only port must not wait for it.
    import asyncio

    from yahboomd.core.clock import sleep_until
    from yahboomd.core.link.line import Line

    state = dict.fromkeys(likely, "was not asked")
    lines: dict[Candidate, Line] = {}
    try:
        for each in likely:
            try:
                lines[each] = Line(await open_it(each.path), clock)
                lines[each].overhear()
            except LinkError as error:
                state[each] = f"cannot be opened: {error.message}"
        listen_ns = max(dialect.listen_ns for dialect in DIALECTS.values())
        await sleep_until(clock, clock.now_ns() + listen_ns)
        heard = {each: recognise(line.unread) for each, line in lines.items()}
        speaking = [DIALECTS[name] for name in heard.values() if name]
        state.update({each: IS_ONE for each, name in heard.items() if name})
        # A stream that was switched on does not exclude another board, which may be silent.
        settled = bool(speaking) and all(dialect.listen_ns for dialect in speaking)
        for usb in () if settled else usb_ids():
            group = [each for each in likely if each.usb == usb]
            asked = [each for each in group if each in lines and not heard[each]]
            answers = await asyncio.gather(*(_answers(lines[each]) for each in asked))
            for each, answered in zip(asked, answers, strict=True):
                state[each] = IS_ONE if answered else "does not answer as one"
            if IS_ONE in state.values() or not lines.keys() >= set(group):
                break
    finally:
        for line in lines.values():
            line.port.close()
    boards = [each for each in likely if state[each] == IS_ONE]
    # Opening a held one raises an error that names its holder.
    boards = boards or [each for each in likely if each not in lines][:1]
    words = "; ".join(f"{each.path} ({each.usb}) {said}" for each, said in state.items())
    if not boards:
        starts_s = max(dialect.starts_within_s for dialect in DIALECTS.values())
        raise BoardSilent(
            f"no board answers on any of several ports: {words}.",
            remedy=f"Is its supply on? It may be silent for {starts_s:g} s after that. {NAME_IT}",
        )
    if len(boards) > 1:
        names = "\n".join(f'port = "{each.by_path or each.path}"' for each in boards)
        raise ConfigError(
            f"serial.port is empty and several boards are there: {words}.",
            remedy=f"{NAME_IT} One of these lines under [serial]:\n{names}",
        )
    return boards[0].path, f"Several ports could be the board: {words}."


async def _answers(line: Line) -> bool:
    from yahboomd.core.link.handshake import identify

    try:
        await identify(line)
    except (LinkError, BoardError):
        return False
    return True


def choose(configured: str, found: Iterable[Candidate], *, udev_name: str = UDEV_NAME) -> str:
    """The port to open, if one at most looks like the board's.

    Raises:
        PortMissing: None does.
    """
    if configured:
        return configured
    if os.path.exists(udev_name):
        return udev_name
    ports = tuple(found)
    for each in ports:
        if each.is_ch340:
            return each.path
    others = ", ".join(f"{each.path} ({each.description})" for each in ports)
    raise PortMissing(
        f"no {udev_name} and no CH340 on USB"
        + (f"; other ports: {others}" if others else "")
        + ".",
        remedy=without_driver() or "Plug the board in, or name its port: --port PATH.",
    )


def without_driver(sysfs: Path = Path("/sys/bus/usb/devices")) -> str:
    """The fault if a CH340 is on USB without a tty; else empty."""
    for vendor in sorted(sysfs.glob("*/idVendor")):
        folder = vendor.parent
        try:
            usb = f"{vendor.read_text().strip()}:{(folder / 'idProduct').read_text().strip()}"
        except OSError:
            continue
        if usb in usb_ids() and not any(folder.glob("*/tty*")):
            drivers = sorted({link.resolve().name for link in folder.glob("*:*/driver")})
            if any("usbfs" in each for each in drivers):
                return (
                    "A CH340 is on USB, but another program took it from the kernel, most likely "
                    "brltty: sudo apt remove brltty, then plug the board in again."
                )
            return (
                "A CH340 is on USB, but the kernel made no tty of it: its ch341 driver is missing "
                "(some Jetson kernels lack it). Try: sudo modprobe ch341; docs/troubleshooting.md "
                "explains how to build it."
            )
    return ""


def _by_path(device: str) -> str | None:
    links = sorted(Path("/dev/serial/by-path").glob("*"))
    return next((str(link) for link in links if link.resolve() == Path(device).resolve()), None)
