"""The vendors' own firmwares as boards of simulated robots: the judges of the simulated boards.

Nothing of a vendor's is in this project. The files are in the folder that ``YAHBOOMD_FIRMWARE``
names, or else beside the project; `make firmware` prints where to get them. The firmware computes;
motors, chassis, line and every fault are those of the simulated robot, so that each test of a
simulated board can be one of the firmware's.
"""

from __future__ import annotations

import functools
import importlib.util
import os
import sys
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from random import Random
from types import ModuleType
from typing import Any, TypeVar

import pytest

from yahboomd.core.model import CHANNELS, Counts
from yahboomd.simulation.board import Emit
from yahboomd.simulation.boards import BOARDS, BoardKind
from yahboomd.simulation.four_channel.flash import FlashContent
from yahboomd.simulation.motors import PWM_MAX
from yahboomd.simulation.options import SMOOTH, SimulationOptions
from yahboomd.simulation.plant import Plant
from yahboomd.simulation.wire import transfer_ns

FOLDER = Path(os.environ.get("YAHBOOMD_FIRMWARE") or Path(__file__).parents[3] / "shared/firmware")
IMAGE = "four_channel/FourWay_Motor_STM32.hex"
STORES_S = 0.4
"""Longer than any command of the four-channel board takes, a factory reset left aside."""


MOTORS: dict[str, dict[str, Any]] = {
    name: {
        "motor_dead_zone": dead_zone,
        "time_constant_s": lag_s,
        "max_speed_m_s": fastest_m_s,
        **SMOOTH,
    }
    for name, dead_zone, lag_s, fastest_m_s in (
        ("35 %, quick", 1260, 0.05, 1.05),
        ("40 %", 1440, 0.1, 1.15),
        ("44 %, slow", 1584, 0.2, 0.70),
        ("50 %", 1800, 0.1, 1.40),
        ("54 %, 550 rev/min", 1944, 0.06, 1.93),
        ("44 %, lazy", 1584, 0.3, 1.15),
    )
}
"""Motors by the share of the output at which they begin to turn."""

STICKING: dict[str, dict[str, Any]] = {
    "40 %, sticks": {**MOTORS["40 %"], "friction_scales": (1.0, 1.1, 0.95, 1.03), "sticks": (1.3,)},
}
"""Unequal motors on a floor with static friction: two of four begin to turn at 52 and 57 %."""

KINDS = {**MOTORS, **STICKING}

LONG = bool(os.environ.get("YAHBOOMD_FIRMWARE_LONG"))
"""Whether every case is tried, by `make firmware-long`."""

Case = TypeVar("Case")


def of_all(cases: Iterable[Case], every: int, first: int = 0) -> list[Case]:
    """The cases that are tried: all, or in the short form each so manieth."""
    return list(cases) if LONG else list(cases)[first::every]


def kinds(every: int, first: int = 0) -> list[str]:
    """The motors that are tried, and every one that sticks."""
    return [*of_all(MOTORS, every, first), *STICKING]


def missing() -> str:
    """Why the four-channel board's firmware cannot run here; empty if it can."""
    if not (FOLDER / IMAGE).exists():
        return f"{FOLDER / IMAGE} is missing"
    if importlib.util.find_spec("unicorn") is None:
        return "unicorn is not installed (`make firmware` installs it)"
    return ""


@functools.cache
def rig(name: str) -> ModuleType:
    """A module of the folder, such as ``four_channel/board``."""
    path = FOLDER / f"{name}.py"
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[f"firmware_{path.stem}"] = module
    spec.loader.exec_module(module)
    return module


@functools.cache
def image() -> bytes:
    with warnings.catch_warnings():
        # The rig leaves its file to the collector.
        warnings.simplefilter("ignore", ResourceWarning)
        return bytes(rig("four_channel/board").load_image(str(FOLDER / IMAGE)))


ROSMASTER_LIBRARY = (
    Path(
        os.environ.get("YAHBOOMD_CACHE")
        or Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "yahboomd"
    )
    / "firmware/librosfw.so"
)
"""The Rosmaster board's firmware, compiled for this machine by `make firmware`."""


def rosmaster_missing() -> str:
    """Why the Rosmaster board's firmware cannot run here; empty if it can."""
    return "" if ROSMASTER_LIBRARY.exists() else f"{ROSMASTER_LIBRARY} is missing"


def rosmaster(car: int, car_type: int) -> Any:
    """The Rosmaster board's firmware with motors of its rig, moved on by ``ms()``.

    Args:
        car: The car that it is built into.
        car_type: The stored car type.
    """
    os.environ["ROSMASTER_FIRMWARE"] = str(ROSMASTER_LIBRARY)
    return rig("rosmaster/rosmaster_board").Board(car=car, type_=car_type)


class _Motor:
    """A motor of the emulated board that is one of the plant's."""

    stalled, forced, supply, vel = False, None, 1.0, 0.0

    def __init__(self, board: FirmwareStreamed, index: int) -> None:
        self._board, self._index, self._duty = board, index, 0.0

    def advance(self, t_ns: int) -> None:
        self._board.advance_plant(t_ns)

    def counts(self) -> int:
        return self._board.plant.ticks[self._index]

    @property
    def duty(self) -> float:
        return self._duty

    @duty.setter
    def duty(self, duty: float) -> None:
        if duty != self._duty:
            self._duty = duty
            self._board.set_outputs()


@functools.cache
def _quick_board() -> type[Any]:
    """The rig's board, whose host need not stop for each empty word that is written to flash."""
    rigs = rig("four_channel/board")

    class QuickBoard(rigs.Board):  # type: ignore[name-defined, misc]
        def _flash_store(
            self, uc: Any, access: int, address: int, size: int, value: int, data: Any
        ) -> None:
            offset = address if address < rigs.FLASH_SIZE else address - rigs.FLASH
            if size == 2 and value & 0xFFFF == 0xFFFF and self.flash[offset : offset + 2] == EMPTY:
                now_ns = self.now()
                self._warp(now_ns, now_ns + self.program_ns)
                self.regs[rigs.FPEC + 0xC] = self.regs.get(rigs.FPEC + 0xC, 0) | 0x20
            else:
                super()._flash_store(uc, access, address, size, value, data)

    return QuickBoard


EMPTY = b"\xff\xff"


class FirmwareStreamed:
    """Firmware 1.7.3 of the four-channel board, with the plant's motors.

    Attributes:
        cpu: The emulator.
    """

    def __init__(
        self, options: SimulationOptions, plant: Plant, emit: Emit, random: Random
    ) -> None:
        self.emit = emit
        self.plant = plant
        self._started = False
        self._shift_ns = 0
        self._byte_ns = transfer_ns(1, options.baud)
        board = rig("four_channel/board")
        wiring = {1: "520", 2: "310", 3: "tt"}[options.motor_type]
        self.cpu: Any = _quick_board()(
            image(), wiring=wiring, battery=options.battery_volts, seed=random.randrange(2**32)
        )
        self._motors = [_Motor(self, index) for index in range(CHANNELS)]
        self.cpu.motors = self._motors
        for (timer, _), motor in zip(board.ENCODERS, self._motors, strict=True):
            self.cpu.encoders[timer].motor = motor
        self.cpu.run_for(0.05)
        self._hangs = False
        self.store(options.flash)

    def store(self, flash: object) -> None:
        """Store settings before the robot's time begins."""
        flash = flash if isinstance(flash, FlashContent) else FlashContent()
        gains = ",".join(f"{gain:g}" for gain in (flash.p, flash.i, flash.d))
        for words in (
            f"$mtype:{flash.motor_type}#",
            f"$deadzone:{flash.dead_zone}#",
            f"$mline:{flash.lines}#",
            f"$mphase:{flash.ratio}#",
            f"$wdiameter:{flash.wheel_diameter_mm:g}#",
            f"$MPID:{gains}#",
        ):
            self.cpu.send(words.encode())
            self.cpu.run_for(STORES_S)
        self.cpu.take_output()

    # The robot's end.

    @property
    def next_ns(self) -> int:
        return 0

    @property
    def next_tick_ns(self) -> int:
        """When the next interrupt comes that counts and regulates."""
        return int(self.cpu.tim6_at) - self._shift_ns

    @property
    def speaks_ns(self) -> int:
        return self.cpu.vt - self._shift_ns + 1_000_000

    @property
    def totals(self) -> Counts:
        """As the encoders have them: the firmware's own are read from the line."""
        return self.plant.ticks

    def start(self, now_ns: int) -> None:
        self._started = True
        self._shift_ns = self.cpu.vt - now_ns

    def advance_plant(self, t_ns: int) -> None:
        if self._started:
            self.plant.advance(t_ns - self._shift_ns)

    def set_outputs(self) -> None:
        outputs = [round(each.duty * PWM_MAX) for each in self._motors]
        self.plant.set_outputs((outputs[0], outputs[1], outputs[2], outputs[3]))
        self.cpu.battery = self.plant.volts

    def receive(self, byte: int, now_ns: int) -> None:
        self.run_due(now_ns)
        # The line has carried it already.
        usart = self.cpu.u1
        usart.rx_byte = byte
        self.cpu._rx_done(usart, self.cpu.vt)

    def run_due(self, now_ns: int) -> None:
        if self._hangs:
            return
        until_ns = now_ns + self._shift_ns
        if until_ns > self.cpu.vt:
            self.cpu.run_until(until_ns)
        for left_ns, byte in self.cpu.take_output():
            self.emit(bytes((byte,)), max(0, left_ns - self._shift_ns - self._byte_ns))

    def reset(self, now_ns: int, *, off_ns: int = 0, by_power: bool) -> None:
        self.run_due(now_ns)
        self._hangs = False
        self.cpu.reset(off_ns / 1e9)

    def set_tick_period(self, now_ns: int, period_ns: int, jitter_ns: int = 0) -> None:
        raise ValueError("the firmware renews its counters every 10 ms")

    def hang(self) -> None:
        self._hangs = True


ON_THE_FIRMWARE = [
    pytest.mark.skipif(bool(missing()), reason=missing()),
    pytest.mark.usefixtures("vendors_image"),
]
"""Marks of a file whose simulated four-channel boards are the vendor's firmware."""


@contextmanager
def instead_of_simulated() -> Iterator[None]:
    """Have each simulated four-channel board be the vendor's firmware."""
    before = BOARDS["streamed"]
    BOARDS["streamed"] = BoardKind(make=FirmwareStreamed, flash=FlashContent)
    try:
        yield
    finally:
        BOARDS["streamed"] = before
