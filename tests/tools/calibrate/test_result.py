"""A result in words, as JSON and as the file; refused ones write nothing."""

from __future__ import annotations

import asyncio
import json
import threading
from pathlib import Path
from typing import Any

import pytest

from yahboomd.core.config import Config, read
from yahboomd.core.config.calibration_file import Calibration
from yahboomd.core.errors import Refused
from yahboomd.tools.calibrate import calibration_writing
from yahboomd.tools.calibrate.estimates.least_squares import Fit
from yahboomd.tools.calibrate.estimates.runs import Factors
from yahboomd.tools.calibrate.result import conclude
from yahboomd.tools.terminal.asking import Answers

GOOD = Fit(
    factors=Factors(1.02, 1.01, 0.95),
    std=Factors(1e-3, 1e-4, 2e-3),
    chi_squared=1.2,
    errors=((0.001, 0.002),),
)
BAD = Fit(factors=Factors(1.5), std=GOOD.std, chi_squared=1.2, errors=((0.001, 0.002),))


def concluded(*given: Any, **named: Any) -> None:
    asyncio.run(conclude(*given, method="tape", runs=(), **named))


def test_a_good_result_is_written_and_read_back(tmp_path: Path, capsys) -> None:
    path = tmp_path / "state" / "calibration.toml"
    concluded(GOOD, Config(), path, dry_run=False, person=Answers())
    out, err = capsys.readouterr()
    assert "radius left         1.00000     1.01493" in out
    assert f"Written to {path}" in err
    chassis = read(None, environ={"STATE_DIRECTORY": str(path.parent)}).config.chassis
    assert chassis.wheel_separation_multiplier == 0.95
    ratio = chassis.wheel_radius_multiplier["right"] / chassis.wheel_radius_multiplier["left"]
    assert ratio == pytest.approx(1.01, abs=2e-6)


def test_a_dry_run_writes_nothing(tmp_path: Path, capsys) -> None:
    path = tmp_path / "calibration.toml"
    concluded(GOOD, Config(), path, dry_run=True, person=Answers(as_json=True))
    facts = json.loads(capsys.readouterr().out)
    assert (facts["written"], facts["refused"]) == (None, [])
    assert not path.exists()


def test_a_result_that_cannot_be_trusted_writes_nothing_and_says_why(
    tmp_path: Path, capsys
) -> None:
    path = tmp_path / "calibration.toml"
    with pytest.raises(Refused, match=r"The left wheels' radius would be 1\.500"):
        concluded(BAD, Config(), path, dry_run=False, person=Answers(as_json=True))
    facts = json.loads(capsys.readouterr().out)
    assert facts["written"] is None
    assert len(facts["refused"]) == 2
    assert not path.exists()


def test_a_size_that_is_another_gear_names_the_profile_that_fits(tmp_path: Path, capsys) -> None:
    geared = Fit(factors=Factors(0.536), std=GOOD.std, chi_squared=1.2, errors=GOOD.errors)
    path = tmp_path / "calibration.toml"
    with pytest.raises(Refused, match=r"0\.536 is 30/56: .* board\.profile = \"520-1:56\""):
        concluded(geared, Config(), path, dry_run=False, person=Answers())
    own = Config.model_validate({"chassis": {"ticks_per_revolution": 1320.0}})
    with pytest.raises(Refused, match="radius would be") as refused:
        concluded(geared, own, path, dry_run=False, person=Answers())
    assert "30/56" not in str(refused.value)
    capsys.readouterr()
    assert not path.exists()


def test_an_x3_that_counts_1040_is_not_called_a_sunrise(tmp_path: Path, capsys) -> None:
    geared = Fit(factors=Factors(1.27), std=GOOD.std, chi_squared=1.2, errors=GOOD.errors)
    x3 = Config.model_validate({"board": {"profile": "x3"}})
    with pytest.raises(Refused, match=r"ticks_per_revolution = 1040, and leave") as refused:
        concluded(geared, x3, tmp_path / "c.toml", dry_run=False, person=Answers())
    assert "sunrise" not in str(refused.value)
    capsys.readouterr()


async def test_a_slow_disk_holds_up_no_loop_and_a_cancellation_does_not_cut_a_file(
    tmp_path: Path, capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun, goes_on = threading.Event(), threading.Event()
    write = calibration_writing.write_calibration

    def slow(path: Path, made: Calibration) -> None:
        begun.set()
        assert goes_on.wait(10.0)
        write(path, made)

    monkeypatch.setattr(calibration_writing, "write_calibration", slow)
    path = tmp_path / "calibration.toml"
    work = asyncio.create_task(
        conclude(GOOD, Config(), path, method="tape", runs=(), dry_run=False, person=Answers())
    )
    while not begun.is_set():
        await asyncio.sleep(0)
    work.cancel()
    await asyncio.sleep(0)
    assert not work.done()
    goes_on.set()
    await work
    assert f"Written to {path}" in capsys.readouterr().err
    assert read(None, environ={"STATE_DIRECTORY": str(tmp_path)}).warnings == ()
