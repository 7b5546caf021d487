"""The port that is chosen, and the fault without one."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from binary_dialect import registered
from board_bench import BoardPort, LinkBench
from serial.tools import list_ports
from serial.tools.list_ports_common import ListPortInfo

from yahboomd.core.errors import BoardSilent, ConfigError, PortBusy, PortMissing
from yahboomd.core.link.discovery import Candidate, candidates, choose, find, without_driver
from yahboomd.core.link.port import byte_time_ns
from yahboomd.core.protocol.registry import DIALECTS, usb_ids
from yahboomd.simulation.virtual_time import LoopClock, on_virtual_time

NOWHERE = "/nonexistent/yahboom_driver"
LIKELY, UNLIKELY = usb_ids()


def board(path: str, usb: str = LIKELY) -> Candidate:
    return Candidate(path=path, description="USB Serial", usb=usb, is_ch340=True, by_path=None)


def other(path: str) -> Candidate:
    return Candidate(path=path, description="GPS", is_ch340=False, by_path=None)


def test_a_configured_port_is_taken_as_it_is() -> None:
    assert choose("/dev/ttyX", [board("/dev/ttyUSB0")]) == "/dev/ttyX"


def test_the_name_of_the_udev_rule_comes_before_a_search(tmp_path: Path) -> None:
    name = tmp_path / "yahboom_driver"
    name.touch()
    assert choose("", [board("/dev/ttyUSB0")], udev_name=str(name)) == str(name)


def test_the_only_ch340_is_taken() -> None:
    found = [other("/dev/ttyACM0"), board("/dev/ttyUSB1")]
    assert choose("", found, udev_name=NOWHERE) == "/dev/ttyUSB1"


def test_no_board_names_the_ports_that_are_there() -> None:
    with pytest.raises(PortMissing, match=r"/dev/ttyACM0 \(GPS\).*--port"):
        choose("", [other("/dev/ttyACM0")], udev_name=NOWHERE)


def usb_device(
    sysfs: Path, *, driver: str | None = None, tty: bool = False, usb: str = UNLIKELY
) -> None:
    vendor, product = usb.split(":")
    folder = sysfs / "1-2"
    interface = folder / "1-2:1.0"
    interface.mkdir(parents=True)
    (folder / "idVendor").write_text(f"{vendor}\n")
    (folder / "idProduct").write_text(f"{product}\n")
    if driver:
        (sysfs / "drivers" / driver).mkdir(parents=True)
        (interface / "driver").symlink_to(sysfs / "drivers" / driver)
    if tty:
        (interface / "ttyUSB0").mkdir()


def test_a_board_without_a_tty_names_the_missing_driver(tmp_path: Path) -> None:
    usb_device(tmp_path)
    assert "ch341" in without_driver(tmp_path)


def test_a_board_taken_by_brltty_names_it(tmp_path: Path) -> None:
    usb_device(tmp_path, driver="usbfs")
    assert "brltty" in without_driver(tmp_path)


def test_a_board_with_a_tty_is_nothing_to_complain_about(tmp_path: Path) -> None:
    usb_device(tmp_path, driver="ch341", tty=True)
    assert without_driver(tmp_path) == ""


def test_looking_at_this_machine_does_not_fail() -> None:
    assert isinstance(candidates(), tuple)


def test_the_likelier_chip_comes_first_and_others_last(monkeypatch: pytest.MonkeyPatch) -> None:
    def port(name: str, usb: str | None) -> ListPortInfo:
        info = ListPortInfo(f"/dev/{name}", skip_link_detection=True)
        if usb is not None:
            info.vid, info.pid = (int(part, 16) for part in usb.split(":"))
        return info

    ports = [port("A", UNLIKELY), port("B", "10c4:ea60"), port("C", LIKELY), port("D", None)]
    monkeypatch.setattr(list_ports, "comports", lambda: ports)
    found = candidates()
    assert [each.path for each in found] == ["/dev/C", "/dev/A", "/dev/B"]
    assert [each.is_ch340 for each in found] == [True, True, False]
    assert found[1].usb == "1a86:7522"


def test_the_chip_of_another_board_is_known_by_its_dialect_alone(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    info = ListPortInfo("/dev/B", skip_link_detection=True)
    info.vid, info.pid = 0x10C4, 0xEA60
    monkeypatch.setattr(list_ports, "comports", lambda: [info])
    usb_device(tmp_path, usb="10c4:ea60")
    assert not candidates()[0].is_ch340
    assert without_driver(tmp_path) == ""
    with registered():
        # Behind those of the boards before it.
        assert usb_ids() == (LIKELY, UNLIKELY, "10c4:ea60")
        assert candidates()[0].is_ch340
        assert without_driver(tmp_path) != ""


class VoiceModule:
    """A device with a board's chip: it reports words as old and new ones do, and takes bytes."""

    name = "/dev/voice"
    byte_ns = byte_time_ns(115200)
    closed = False

    def __init__(self) -> None:
        self.written = b""

    def listen(self, on_data, on_lost) -> None:
        asyncio.get_running_loop().call_later(0.05, on_data, b"\xaa\x55\x03\x00\xfb$B001#")

    def write(self, data: bytes) -> None:
        self.written += data

    def queued(self) -> int:
        return 0

    def close(self) -> None:
        self.closed = True


class Desk:
    """Devices behind ports, each with its USB id; None is held by another process."""

    def __init__(self, **devices: tuple[str, LinkBench | VoiceModule | None]) -> None:
        self.found = [board(f"/dev/{name}", usb) for name, (usb, _) in devices.items()]
        self._devices = {f"/dev/{name}": device for name, (_, device) in devices.items()}
        self.opened: list[str] = []

    async def open(self, path: str) -> BoardPort | VoiceModule:
        self.opened.append(path)
        device = self._devices[path]
        if device is None:
            raise PortBusy(f"{path} is held by mpg123 (pid 7).")
        return await device.open() if isinstance(device, LinkBench) else device

    async def find(self, configured: str = "") -> tuple[str, str]:
        return await find(configured, self.found, self.open, LoopClock())  # type: ignore[arg-type]


def written(bench: LinkBench) -> bytes:
    return b"".join(data for port in bench.ports for _, data in port.written)


@on_virtual_time
async def test_a_board_that_reports_is_heard_and_no_device_is_sent_a_byte() -> None:
    car, voice = LinkBench(dialect="rosmaster", start_up_s=0.0), VoiceModule()
    (await car.open()).close()
    await asyncio.sleep(1.0)
    for ids in ((LIKELY, UNLIKELY), (LIKELY, LIKELY), (UNLIKELY, LIKELY)):
        path, words = await Desk(car=(ids[0], car), voice=(ids[1], voice)).find()
        assert path == "/dev/car"
        assert f"/dev/voice ({ids[1]}) was not asked" in words
    assert written(car) == b""
    assert voice.written == b""
    assert voice.closed
    assert all(port.closed for port in car.ports[1:])


@pytest.mark.parametrize("dialect", sorted(DIALECTS))
@on_virtual_time
async def test_a_silent_board_of_the_likelier_chip_is_asked_and_the_other_is_not(
    dialect: str,
) -> None:
    silent, voice = LinkBench(dialect=dialect, start_up_s=0.0), VoiceModule()
    if dialect == "rosmaster":
        # Its reports are switched off.
        port = await silent.open()
        port.write(bytes.fromhex("fffc0501000006"))
        await asyncio.sleep(0.1)
        port.close()
    path, words = await Desk(voice=(UNLIKELY, voice), board=(LIKELY, silent)).find()
    assert path == "/dev/board"
    assert words == (
        "Several ports could be the board: /dev/voice (1a86:7522) was not asked; "
        "/dev/board (1a86:7523) is a board."
    )
    assert voice.written == b""
    stops = [DIALECTS[dialect].surest_stop in data for _, data in silent.ports[-1].written]
    asks = [DIALECTS[dialect].probe in data for _, data in silent.ports[-1].written]
    assert stops.index(True) < asks.index(True)


@on_virtual_time
async def test_a_board_of_the_less_likely_chip_is_asked_after_the_other_device() -> None:
    polled, other = LinkBench(dialect="polled"), VoiceModule()
    path, words = await Desk(board=(UNLIKELY, polled), other=(LIKELY, other)).find()
    assert path == "/dev/board"
    assert "/dev/other (1a86:7523) does not answer as one" in words


@on_virtual_time
async def test_a_heard_stream_does_not_hide_a_silent_second_board() -> None:
    streaming, silent = LinkBench(), LinkBench()
    await streaming.drive(0, 0.1)
    with pytest.raises(ConfigError):
        await Desk(one=(LIKELY, streaming), two=(LIKELY, silent)).find()
    # Of the other chip it may be another device, and is not asked.
    voice = VoiceModule()
    path, _ = await Desk(one=(LIKELY, streaming), voice=(UNLIKELY, voice)).find()
    assert path == "/dev/one"
    assert voice.written == b""


@on_virtual_time
async def test_two_boards_are_refused_with_lines_to_paste() -> None:
    desk = Desk(one=(LIKELY, LinkBench()), two=(LIKELY, LinkBench(dialect="polled")))
    with pytest.raises(ConfigError) as refused:
        await desk.find()
    assert "/dev/one (1a86:7523) is a board; /dev/two (1a86:7523) is a board" in str(refused.value)
    assert refused.value.remedy.splitlines()[1:] == ['port = "/dev/one"', 'port = "/dev/two"']


@on_virtual_time
async def test_where_none_is_a_board_each_is_named_and_no_voice_module_is_commanded() -> None:
    one, two = VoiceModule(), VoiceModule()
    with pytest.raises(BoardSilent, match=r"one \(1a86:7523\) does not.*two \(1a86:7522\) does"):
        await Desk(one=(LIKELY, one), two=(UNLIKELY, two)).find()
    # The commands of an older module are $A001#, those of a newer one AA 55 FF 01 FB.
    for module in (one, two):
        assert b"$read_flash#" in module.written
        assert b"$A" not in module.written
        assert b"\xaa\x55" not in module.written


@on_virtual_time
async def test_a_held_port_of_the_likelier_chip_is_the_board_and_no_other_is_asked() -> None:
    voice = VoiceModule()
    path, words = await Desk(board=(LIKELY, None), voice=(UNLIKELY, voice)).find()
    assert path == "/dev/board"
    assert "cannot be opened: /dev/board is held by mpg123 (pid 7)" in words
    assert voice.written == b""


@on_virtual_time
async def test_a_free_board_is_taken_while_another_is_held() -> None:
    path, _ = await Desk(held=(LIKELY, None), free=(LIKELY, LinkBench())).find()
    assert path == "/dev/free"


@on_virtual_time
async def test_a_named_port_and_the_only_likely_one_are_not_listened_to() -> None:
    several = Desk(one=(LIKELY, None), two=(LIKELY, None))
    assert await several.find("/dev/ttyX") == ("/dev/ttyX", "")
    alone = Desk(one=(LIKELY, None))
    assert await alone.find() == ("/dev/one", "")
    assert several.opened == alone.opened == []
