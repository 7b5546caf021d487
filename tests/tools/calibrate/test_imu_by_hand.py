"""A person turns a simulated robot by hand, on virtual time; its sensor tells how it is mounted."""

from __future__ import annotations

import asyncio
import math
from collections.abc import AsyncIterator
from random import Random
from typing import Any

import msgspec
import pytest

from make.schema_files.samples import NATIVE
from yahboomd.client.services import Answer
from yahboomd.core.config import Config, Loaded
from yahboomd.core.errors import Refused
from yahboomd.core.messages.native import ImuSample, StatusSample
from yahboomd.core.model import STANDSTILL, ImuReading, ImuSensor, Twist2d
from yahboomd.core.protocol.registry import DIALECTS
from yahboomd.simulation.imu import MPU9250, ImuModel
from yahboomd.simulation.virtual_time import on_virtual_time
from yahboomd.tools.calibrate.calibration import calibrate
from yahboomd.tools.calibrate.choices import HandTurns
from yahboomd.tools.calibrate.estimates.hand_turn import Mounted
from yahboomd.tools.calibrate.imu_by_hand import show_mounted, turn_by_hand
from yahboomd.tools.terminal.asking import Answers

SENSOR = ImuSensor(
    name="mpu9250",
    gyro_limit_rad_s=8.7,
    gyro_noise_rad_s=1e-3,
    acceleration_limit_m_s2=20.0,
    acceleration_noise_m_s2=0.01,
)


class Bench:
    """A robot on the floor, a sensor on it, and a person beside it who does as asked."""

    enter = "Enter"

    def __init__(
        self,
        config: Config,
        *,
        axes: str,
        turns: float,
        silent: bool = False,
        kind: str = "mpu9250",
    ) -> None:
        usual = {each.name: each for each in DIALECTS["rosmaster"].sensors}
        self.sensor = msgspec.structs.replace(SENSOR, name=kind, axes=usual[kind].axes)
        self.said: list[str] = []
        self.found: dict[str, Any] = {}
        self.config = config
        self.turns = turns
        self.silent = silent
        self.questions: list[str] = []
        self.wz = 0.0
        self.lose = False
        options = msgspec.structs.replace(MPU9250, axes=axes, gyro_scale=0.0, warming_k=0.0)
        self._imu = ImuModel(options, Random(1))

    def stream(self) -> AsyncIterator[ImuSample]:
        return self._samples()

    async def _samples(self) -> AsyncIterator[ImuSample]:
        loop, template = asyncio.get_running_loop(), NATIVE["ImuSample"]
        while True:
            await asyncio.sleep(1000.0 if self.silent else 0.3 if self.lose else 0.04)
            now_ns = round(loop.time() * 1e9)
            twist = Twist2d(wz=self.wz) if self.wz else STANDSTILL
            shown = self._imu.sample(now_ns, twist, 0.0)
            reading = self.config.imu.mounting().along_base(
                ImuReading(
                    sensor=self.sensor,
                    sent_ns=now_ns,
                    gyro_rad_s=shown.gyro_rad_s,
                    acceleration_m_s2=shown.acceleration_m_s2,
                )
            )
            assert isinstance(template, ImuSample)
            yield msgspec.structs.replace(
                template,
                stamp_ns=now_ns,
                gyro_rad_s=reading.gyro_rad_s,
                acceleration_m_s2=reading.acceleration_m_s2,
            )

    def say(self, words: str) -> None:
        self.said.append(words)

    def result(self, text: str, facts: dict[str, Any]) -> None:
        self.found = facts

    async def confirm(self, name: str, words: str) -> None:
        self.questions.append(words)
        if name == "turned":
            self.wz = 2.0
            await asyncio.sleep(self.turns * math.pi)
            self.wz = 0.0
        await asyncio.sleep(0.5)

    async def run(self, turns: float = 3) -> Mounted:
        return await turn_by_hand(self.stream, self, self.config, turns)


@on_virtual_time
async def test_a_sensor_that_is_mounted_as_configured_is_right_and_its_scale_is_found(
    capsys: pytest.CaptureFixture[str],
) -> None:
    config = Config.model_validate({"imu": {"axes": "x y z"}})
    found = await Bench(config, axes="x y z", turns=3.0).run()
    assert (found.axes, found.gyro_axes) == ("x y z", "")
    assert found.gyro_scale == pytest.approx(1.0, abs=5e-3)
    show_mounted(found, config, Answers())
    out, err = capsys.readouterr()
    assert out.startswith('[imu]\naxes = "x y z"\ngyro_scale = ')
    assert "right" in err


@on_virtual_time
async def test_one_on_its_back_is_found_and_what_is_printed_makes_it_right(
    capsys: pytest.CaptureFixture[str],
) -> None:
    config = Config.model_validate({"imu": {"axes": "x y z"}})
    found = await Bench(config, axes="x -y -z", turns=3.0).run()
    assert found.axes.split()[2] == "-z"
    show_mounted(found, config, Answers())
    out, err = capsys.readouterr()
    assert "wrong" in err
    given = Config.model_validate({"imu": {"axes": found.axes, "gyro_axes": found.gyro_axes}})
    again = await Bench(given, axes="x -y -z", turns=3.0).run()
    show_mounted(again, given, Answers())
    assert "right" in capsys.readouterr().err
    assert f'axes = "{found.axes}"' in out


class Daemon:
    """The daemon's answers, with the samples of a bench."""

    def __init__(self, bench: Bench, sensor: str) -> None:
        self._bench = bench
        self._sensor = sensor

    async def get(self, message: type[StatusSample]) -> StatusSample:
        status = NATIVE["StatusSample"]
        assert isinstance(status, StatusSample)
        return msgspec.structs.replace(status, board={"imu": self._sensor})

    async def call(self, key: str, *, timeout_s: float) -> Answer:
        return Answer(
            success=True, message="", answered=1, data=self._bench.config.resolved().as_data()
        )

    def samples(self, message: type[ImuSample], *, depth: int) -> AsyncIterator[ImuSample]:
        return self._bench.stream()


@pytest.mark.parametrize(
    ("name", "axes", "right"),
    [("icm20948", "x -y -z", True), ("icm20948", "x y z", False), ("mpu9250", "x y z", True)],
)
@on_virtual_time
async def test_without_axes_those_of_the_daemons_sensor_are_checked(
    name: str, axes: str, right: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    bench = Bench(Config(), axes=axes, turns=3.0, kind=name)
    await calibrate(
        Daemon(bench, name),  # type: ignore[arg-type]
        Loaded(bench.config, None),  # type: ignore[arg-type]
        HandTurns(turns=3),
        bench,  # type: ignore[arg-type]
    )
    assert ("The axes are right." in bench.said) == right
    assert bench.found["axes"].split()[2] == axes.split()[2]


@on_virtual_time
async def test_other_turns_than_asked_for_are_refused() -> None:
    with pytest.raises(Refused, match=r"[12]\.\d+ turns, and 3 were asked for"):
        await Bench(
            Config.model_validate({"imu": {"axes": "x y z"}}), axes="x y z", turns=2.0
        ).run()


@on_virtual_time
async def test_a_board_without_a_sensor_is_refused_before_anything_is_asked() -> None:
    bench = Bench(Config(), axes="x y z", turns=3.0, silent=True)
    with pytest.raises(Refused, match="no samples"):
        await bench.run()
    assert bench.questions == []
