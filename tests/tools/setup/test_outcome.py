from __future__ import annotations

import json
from pathlib import Path

import msgspec
from simulated_person import outcome

from yahboomd.tools.calibrate.estimates.wiring import WiringFault
from yahboomd.tools.setup.outcome import next_steps, result

FAULT = WiringFault("encoder_crossed", 1, "left", "Exchange them.", arrives=2)


def test_programs_get_one_line() -> None:
    found = msgspec.structs.replace(outcome(), imu="mpu9250")
    wiring = msgspec.structs.replace(found.wiring, faults=(FAULT,))
    line = result(msgspec.structs.replace(found, wiring=wiring), Path("robot.toml"))
    assert "\n" not in line
    facts = json.loads(line)
    assert facts["motors"][1] == {"wheel": "right", "position": 2, "sign": -1}
    assert facts["faults"][0]["arrives"] == 2
    assert (facts["file"], facts["imu"]) == ("robot.toml", "mpu9250")
    assert json.loads(result(outcome(), Path("robot.toml")))["imu"] is None


def test_a_person_is_shown_the_wheels_and_what_to_run_next() -> None:
    words = next_steps(outcome(), Path("bot.toml"))
    assert "right        M2, mounted the other way round" in words
    for command in ("config check --config bot.toml", "run --config bot.toml", "calibrate tape"):
        assert f"yahboomd {command}" in words
    assert "imu" not in words
    assert "Repair" not in words
