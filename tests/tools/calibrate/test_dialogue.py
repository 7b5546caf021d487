"""A program leads the wizard; the robot moves only while it reports that a button is held."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import Any

from bench_client import BenchClient
from robot_bench import RobotBench

from yahboomd.core.clock import SystemClock
from yahboomd.core.config import Loaded
from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.virtual_time import on_virtual_time
from yahboomd.tools.calibrate.calibration import calibrate
from yahboomd.tools.calibrate.choices import TapeRuns
from yahboomd.tools.calibrate.dialogue import Dialogue
from yahboomd.tools.calibrate.hold import HeldButton

TRUE_RADIUS_M, TRUE_TRACK_M = 0.0345, 0.162
"""Configured are 0.0335 and 0.150."""

BEYOND = [("side", "1"), ("beyond", "3"), ("beyond", "3")]


def test_progress_is_reported_now_and_then_and_at_the_end() -> None:
    told: list[dict[str, Any]] = []
    dialogue = Dialogue(told.append, SystemClock())
    for each in range(1000):
        dialogue.progress(1, 2, each / 1000.0)
    dialogue.progress(1, 2, 1.0)
    dialogue.progress(2, 2, 0.0)
    assert [(each["part"], each["done"]) for each in (told[0], *told[-2:])] == [
        (1, 0.0),
        (1, 1.0),
        (2, 0.0),
    ]
    assert len(told) < 20


@on_virtual_time
async def test_a_whole_calibration_is_asked_for_in_messages_and_led_by_answers(
    tmp_path: Path,
) -> None:
    told: list[dict[str, Any]] = []
    robot = SimulationOptions(wheel_radius_m=TRUE_RADIUS_M, wheel_separation_m=TRUE_TRACK_M)
    async with RobotBench(tmp_path, (), robot) as bench, BenchClient(bench) as client:
        await bench.ready()
        hold = HeldButton(bench.clock, client.stop)
        dialogue = Dialogue(told.append, bench.clock, hold)
        file = tmp_path / "calibration.toml"
        loaded = Loaded(bench.config, None, calibration_path=file)  # type: ignore[arg-type]
        choices = TapeRuns(straight_m=1.0, turns=1, speed_m_s=0.4, turn_speed_rad_s=2.0)
        work = asyncio.create_task(
            calibrate(client, loaded, choices, dialogue, hold, clock=bench.clock)  # type: ignore[arg-type]
        )

        async def asked(before: str) -> dict[str, Any]:
            def newest() -> dict[str, Any]:
                questions = [each for each in told if each["type"] == "question"]
                return questions[-1] if questions else {"id": ""}

            await bench.until(lambda: newest()["id"] != before or work.done())
            return newest()

        async def held(question: dict[str, Any]) -> dict[str, Any]:
            while (after := told[-1]) == question or after["type"] == "progress":
                dialogue.press(question["id"], bench.clock.now_ns())
                await asyncio.sleep(0.05)
            return await asked(question["id"])

        question = await asked("")
        assert question["bounds"] == {"distance_m": 1.0, "turn_rad": 0.0, "time_s": 13.8}
        assert "It moves 1 m, for at most 14 s." in question["text"]
        # Holds that are late, and of no question.
        for _ in range(20):
            dialogue.press(question["id"], bench.clock.now_ns() - 400_000_000)
            dialogue.press("move-0", bench.clock.now_ns())
            await asyncio.sleep(0.05)
        assert bench.standing
        while bench.standing:
            dialogue.press(question["id"], bench.clock.now_ns())
            await asyncio.sleep(0.05)
        dialogue.release()
        question = await asked(question["id"])
        assert question["text"].startswith("The button was let go")
        await bench.until(lambda: bench.standing)
        question = await held(question)
        assert (question["kind"], question["name"], question["unit"]) == ("number", "length", "m")
        for wrong in ("far", "100", "0.1"):
            assert dialogue.answer(question["id"], wrong)
            question = await asked(question["id"])
            assert question["wrong"].startswith("A number of metres near 1.0")
        for name, text in (("length", "1.03"), ("left", ""), *BEYOND):
            if question["kind"] == "hold":
                question = await held(question)
            assert question["name"] == name
            assert dialogue.answer(question["id"], text)
            assert not dialogue.answer(question["id"], text)
            question = await asked(question["id"])
        await work
    progress = next(each for each in told if each["type"] == "progress")
    assert progress == {"type": "progress", "part": 1, "parts": 1, "done": 0.0}
    result, said = told[-2:]
    assert result["facts"]["written"] == str(file)
    assert "radius left" in result["text"]
    assert said["text"].startswith("Written to")
    # As lines have it.
    assert json.loads(json.dumps(result))["facts"]["method"] == "tape"
    assert file.exists()
