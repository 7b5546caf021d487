"""The vendor's Python library 3.3.9 on a pseudo-terminal, on both Rosmaster boards.

What it sends has to do the same on both, and what it reads has to be the same, and true. It comes
from the vendor's archive at test time. Its sleeps move the board's time on, and each waits until
the library has taken in what the board sent meanwhile, so that no machine is too busy for it.
"""

from __future__ import annotations

import contextlib
import importlib.util
import math
import os
import pty
import tarfile
import threading
import tty
import warnings
from collections.abc import Iterator
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
import serial
from rosmaster_firmware import MS, firmware_instead_of_simulated, like_the_firmwares
from vendor_firmware import FOLDER, rosmaster_missing

from yahboomd.core.protocol.rosmaster.packets import PacketFramer, Words
from yahboomd.simulation.robot import SimulatedRobot

pytestmark = [
    pytest.mark.skipif(bool(rosmaster_missing()), reason=rosmaster_missing()),
    pytest.mark.realtime,
]

ARCHIVE = FOLDER / "rosmaster/vendor-3.5.1.tar.gz"
MEMBER = "Rosmaster_Lib/Rosmaster_Lib.py"
PATIENCE_S = 60.0


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> ModuleType:
    folder = tmp_path_factory.mktemp("vendor")
    with tarfile.open(ARCHIVE) as archive:
        archive.extract(MEMBER, folder, filter="data")
    spec = importlib.util.spec_from_file_location("vendors_library", folder / MEMBER)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class Bench:
    """A robot on a pseudo-terminal, whose time goes on while the library sleeps."""

    def __init__(self, library: ModuleType, car_type: int) -> None:
        self.robot = SimulatedRobot(like_the_firmwares(car_type, volts=11.47, start_up_s=0.5))
        self.now_ns = 0
        self.robot.start(0)
        self.sent = bytearray()
        self._library, self._car_type = library, car_type
        self._frames = self._parsed = 0
        self._framer = PacketFramer()
        self._news, self._listens = threading.Condition(), threading.Event()

    @contextlib.contextmanager
    def car(self) -> Iterator[Any]:
        """The library's car, listening."""
        self._master, slave = pty.openpty()
        tty.setraw(slave)
        os.set_blocking(self._master, False)
        self._library.time = SimpleNamespace(sleep=self.sleep)
        car = self._library.Rosmaster(car_type=self._car_type, com=os.ttyname(slave))
        self._watch(car)
        with warnings.catch_warnings():
            # It makes its thread a daemon's by a method that is deprecated.
            warnings.simplefilter("ignore", DeprecationWarning)
            car.create_receive_threading()
        assert self._listens.wait(PATIENCE_S)
        try:
            yield car
        finally:
            car.ser.cancel_read()
            for thread in threading.enumerate():
                if thread.name == "task_receive":
                    thread.join(PATIENCE_S)
            car.ser.close()
            os.close(slave)
            os.close(self._master)

    def _watch(self, car: Any) -> None:
        parse, receive, flush = (
            car._Rosmaster__parse_data,
            car._Rosmaster__receive_data,
            car.ser.reset_input_buffer,
        )

        def counted(*args: object) -> None:
            parse(*args)
            with self._news:
                self._parsed += 1
                self._news.notify_all()

        def until_closed() -> None:
            # Its loop knows no end.
            threading.current_thread().name = "task_receive"
            with contextlib.suppress(IndexError, serial.SerialException, TypeError):
                receive()

        def flushed() -> None:
            flush()
            self._listens.set()

        car._Rosmaster__parse_data = counted
        car._Rosmaster__receive_data = until_closed
        car.ser.flushInput = flushed

    def sleep(self, seconds: float) -> None:
        """What the library takes for `time.sleep`, and the test, too."""
        self._take()
        for _ in range(max(1, round(seconds * 1000.0))):
            self.now_ns += MS
            for chunk in self.robot.host_reads(self.now_ns):
                if self._listens.is_set():
                    os.write(self._master, chunk)
                    found = self._framer.feed(chunk)
                    self._frames += sum(not isinstance(item, Words) for item in found)
        with self._news:
            arrived = self._news.wait_for(lambda: self._parsed >= self._frames, PATIENCE_S)
        assert arrived, f"{self._frames} frames were sent, {self._parsed} taken in"

    def _take(self) -> None:
        with contextlib.suppress(BlockingIOError):
            while data := os.read(self._master, 4096):
                self.sent += data
                self.robot.host_wrote(data, self.now_ns)


def tour(bench: Bench) -> dict[str, Any]:
    """Use all that the library can do with a board; what it read."""
    seen: dict[str, Any] = {}

    def look(name: str) -> None:
        bench.sleep(0.2)
        seen[name] = {
            "motion": car.get_motion_data(),
            "encoders": car.get_motor_encoder(),
            "volts": car.get_battery_voltage(),
            "gyro": car.get_gyroscope_data(),
            "acceleration": car.get_accelerometer_data(),
            "attitude": car.get_imu_attitude_data(ToAngle=False),
            "outputs": tuple(motor.pwm for motor in bench.robot.plant.motors),
            "truth": bench.robot.truth(bench.now_ns),
        }

    with bench.car() as car:
        bench.sleep(0.1)
        car.set_auto_report_state(enable=True, forever=False)
        seen["version"] = car.get_version()
        seen["type"] = car.get_car_type_from_machine()
        seen["gains"] = car.get_motion_pid()
        seen["centre"] = car.get_akm_default_angle()
        seen["servo"] = car.get_uart_servo_value(1)
        seen["arm"] = car.get_uart_servo_angle_array()
        look("standing")
        for name, velocity in (
            ("ahead", (0.3, 0.0, 0.0)),
            ("curve", (0.25, 0.0, 0.5)),
            ("back", (-0.3, 0.0, 0.0)),
            ("zero", (0.0, 0.0, 0.0)),
        ):
            car.set_car_motion(*velocity)
            bench.sleep(1.5)
            look(name)
        for state in (1, 2, 3, 4, 5, 6, 7, 0):
            car.set_car_run(state, 30 if state else 0)
            bench.sleep(0.6)
            look(f"state {state}")
        car.set_motor(40, 40, 40, 40)
        look("outputs")
        car.reset_car_state()
        look("reset state")
        car.set_akm_steering_angle(20)
        car.set_beep(50)
        car.set_colorful_lamps(0xFF, 1, 2, 3)
        car.set_colorful_effect(1)
        car.set_pwm_servo(2, 45)
        car.set_pid_param(0.251, 0.06, 0.5, forever=True)
        seen["new gains"] = car.get_motion_pid()
        car.set_car_type(4)
        seen["new type"] = car.get_car_type_from_machine()
        seen["stored"] = bench.robot.board.flash  # type: ignore[attr-defined]
        car.reset_flash_value()
        bench.sleep(2.0)
        seen["reset type"] = car.get_car_type_from_machine()
        look("after a factory reset")
    return seen


@pytest.fixture(scope="module", params=[1, 5], ids=["X3", "R2"])
def both(
    request: pytest.FixtureRequest, library: ModuleType
) -> tuple[tuple[Bench, dict[str, Any]], tuple[Bench, dict[str, Any]]]:
    simulated = Bench(library, request.param)
    found = simulated, tour(simulated)
    with firmware_instead_of_simulated():
        firmware = Bench(library, request.param)
    return found, (firmware, tour(firmware))


def test_it_sends_both_boards_the_same(both: Any) -> None:
    (simulated, _), (firmware, _) = both
    assert bytes(simulated.sent) == bytes(firmware.sent)
    assert len(simulated.sent) > 200


def test_what_it_asks_for_is_what_both_boards_store(both: Any) -> None:
    (simulated, own), (_, true) = both
    for name in ("version", "type", "gains", "centre", "servo", "arm", "new gains", "new type"):
        assert own[name] == true[name], name
    car_type = simulated._car_type
    assert (own["version"], own["type"]) == (3.5, car_type)
    assert own["gains"] == [0.8, 0.06, 0.5]
    assert own["new gains"] == [0.25, 0.06, 0.5]
    assert (own["servo"], own["new type"], own["reset type"]) == ((-1, -1), 4, 1)
    assert own["stored"] == true["stored"]


def test_it_reads_the_same_motion_of_both_and_the_true_one(both: Any) -> None:
    (simulated, own), (_, true) = both
    looks = [name for name, value in own.items() if isinstance(value, dict)]
    assert len(looks) > 14
    for name in looks:
        mine, firmwares = own[name], true[name]
        # A count in 10 ms is 26 mm/s on an R2, and 0.13 rad/s.
        assert mine["motion"][:2] == pytest.approx(firmwares["motion"][:2], abs=0.05), name
        assert mine["motion"][2] == pytest.approx(firmwares["motion"][2], abs=0.3), name
        assert mine["encoders"] == pytest.approx(firmwares["encoders"], abs=30), name
        assert mine["volts"] == pytest.approx(firmwares["volts"], abs=0.11), name
        # The simulated sensor has the errors of its data sheet.
        assert mine["gyro"] == pytest.approx(firmwares["gyro"], abs=0.08), name
        assert mine["acceleration"] == pytest.approx(firmwares["acceleration"], abs=1.3), name
        assert mine["attitude"][2] == pytest.approx(firmwares["attitude"][2], abs=0.12), name
        assert mine["outputs"] == pytest.approx(firmwares["outputs"], abs=250), name
        truth = mine["truth"]
        assert math.dist((truth.x, truth.y), (firmwares["truth"].x, firmwares["truth"].y)) < 0.03
        if name != "after a factory reset":
            counted = [ticks for ticks in mine["encoders"] if ticks]
            assert len(counted) in {0, len(simulated.robot.plant.motors)}
    assert own["ahead"]["motion"][0] == pytest.approx(0.3, abs=0.04)
    turn = own["curve"]["truth"].wz
    assert turn == pytest.approx(0.5, abs=0.05)
    assert own["curve"]["motion"][2] == pytest.approx(turn, abs=0.15)
    # The library turns the sensor's z over.
    assert own["curve"]["gyro"][2] == pytest.approx(-turn, abs=0.1)
