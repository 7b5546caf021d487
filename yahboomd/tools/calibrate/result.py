"""The result of a calibration, in words and as the file that the daemon reads."""

from __future__ import annotations

import asyncio
import datetime
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from yahboomd.core.errors import Refused
from yahboomd.tools.calibrate.estimates.gear import another_gear
from yahboomd.tools.calibrate.estimates.verdict import RADIUS, doubts, sideways_doubts

if TYPE_CHECKING:
    from collections.abc import Sequence

    from yahboomd.core.config import Config
    from yahboomd.core.config.calibration_file import Calibration
    from yahboomd.tools.calibrate.estimates.least_squares import Fit
    from yahboomd.tools.calibrate.estimates.runs import Run
    from yahboomd.tools.calibrate.estimates.sideways import Sideways, SidewaysRun
    from yahboomd.tools.terminal.asking import Person

NO_RAMPS: Mapping[str, float] = {}


async def conclude(
    fit: Fit,
    config: Config,
    path: Path | None,
    *,
    method: str,
    runs: Sequence[Run],
    sideways: Sideways | None = None,
    sideways_runs: Sequence[SidewaysRun] = (),
    break_away: Mapping[str, float] = NO_RAMPS,
    dry_run: bool,
    person: Person,
) -> None:
    """Show the result, and write it unless it cannot be trusted.

    Args:
        path: The calibration file; None if there is no state directory.

    Raises:
        Refused: The result cannot be trusted; nothing was written.
        ConfigError: The file cannot be written.
    """
    from yahboomd.tools.stop.unresponsive import restarting

    count = len(runs) + len(sideways_runs)
    calibration = made_of(
        *(fit, config), method=method, runs=count, sideways=sideways, break_away=break_away
    )
    wrong = doubts(
        fit,
        skid_steer=config.kinematics().sides,
        runs=runs,
        track=calibration.chassis.wheel_separation_multiplier,
    )
    wrong += _gear_doubts(fit.factors.scale, config)
    if sideways is not None:
        wrong += sideways_doubts(sideways, sideways_runs)
    target = None if dry_run or wrong else path
    written: Path | None = None
    try:
        if target is not None:
            await _write(target, calibration)
            written = target
    finally:
        facts = _facts(fit, calibration, wrong, written)
        if sideways is not None:
            facts["std"]["sideways"] = sideways.std
        person.result(_table(fit, calibration, sideways), facts)
    if wrong:
        raise Refused("\n".join(["Nothing was written:", *(f"  {words}" for words in wrong)]))
    if dry_run:
        person.say("A dry run: nothing was written.")
        return
    if path is None:
        raise Refused(
            "Nothing was written: there is no state directory. Name the file: "
            "`--set chassis.calibration_file=/path/to/calibration.toml`."
        )
    person.say(
        f"Written to {path}. The daemon reads it when it starts. "
        f"{restarting(tuple(config.zenoh.listen))} `yahboomd calibrate undo` removes it."
    )


async def _write(path: Path, calibration: Calibration) -> None:
    """Write the file in a thread, because a disk may be slow. A cancellation does not end it."""
    from yahboomd.tools.calibrate.calibration_writing import write_calibration

    writing = asyncio.create_task(asyncio.to_thread(write_calibration, path, calibration))
    try:
        await asyncio.shield(writing)
    except asyncio.CancelledError:
        await asyncio.wait({writing})
        writing.result()


def _gear_doubts(scale: float, config: Config) -> list[str]:
    """Sentences if this size of the wheels, over the configured one, fits another gear."""
    from yahboomd.core.protocol.profiles import alike, of_its_board

    own, (least, most) = config.profile(), RADIUS
    if least <= scale <= most or config.chassis.ticks_per_revolution is not None:
        return []
    words = another_gear(scale, own, alike(own), of_its_board(own))
    return [words] if words else []


def ratio_of(config: Config) -> float:
    """The configured radius of the right wheels over that of the left ones."""
    wheels = config.kinematics().wheels
    multipliers = config.chassis.wheel_radius_multiplier
    right, left = (
        sum(multipliers.get(name, 1.0) for name in wheels if name.endswith(side))
        for side in ("right", "left")
    )
    return right / left


def made_of(
    fit: Fit,
    config: Config,
    *,
    method: str,
    runs: int,
    sideways: Sideways | None = None,
    break_away: Mapping[str, float] = NO_RAMPS,
) -> Calibration:
    """The calibration file's contents."""
    from yahboomd.core.config.calibration_file import Calibration, Multipliers, geometry_of

    factors, chassis = fit.factors, config.chassis
    wheels = config.kinematics().wheels
    track = factors.track
    if config.kinematics().holonomic and chassis.wheel_base_m is not None:
        # Only the distance of the sides is calibrated; a mecanum base turns by half of both sums.
        whole = chassis.wheel_separation_m + chassis.wheel_base_m
        track = (track * whole - chassis.wheel_base_m) / chassis.wheel_separation_m
    radii = {
        name: round(factors.left if name.endswith("left") else factors.right, 6) for name in wheels
    }
    return Calibration(
        made=f"{datetime.datetime.now(datetime.UTC):%Y-%m-%d %H:%M} UTC",
        method=method,
        residual=_residual(fit, runs),
        geometry=geometry_of(config),
        chassis=Multipliers(
            wheel_radius_multiplier=radii,
            wheel_separation_multiplier=round(track, 6),
            sideways_multiplier=None if sideways is None else round(sideways.factor, 6),
            break_away_linear_m_s=round(break_away.get("ways", 0.0), 3) or None,
            break_away_angular_rad_s=round(break_away.get("turns", 0.0), 2) or None,
        ),
        before=Multipliers(
            wheel_radius_multiplier={
                name: chassis.wheel_radius_multiplier.get(name, 1.0) for name in wheels
            },
            wheel_separation_multiplier=chassis.wheel_separation_multiplier,
            sideways_multiplier=None if sideways is None else chassis.sideways_multiplier,
            break_away_linear_m_s=chassis.break_away_linear_m_s or None,
            break_away_angular_rad_s=chassis.break_away_angular_rad_s or None,
        ),
    )


def _residual(fit: Fit, runs: int) -> str:
    return f"{fit.chi_squared**0.5:.2f} times what slip and tape explain, {runs} runs"


def _table(fit: Fit, calibration: Calibration, sideways: Sideways | None) -> str:
    before, after = calibration.before, calibration.chassis
    lines = ["                    before      now         known within"]
    for name, value in after.wheel_radius_multiplier.items():
        was = before.wheel_radius_multiplier[name]
        lines.append(f"{f'radius {name}':<20}{was:<12.5f}{value:<12.5f}{_percent(fit.std.scale)}")
    lines.append(
        f"{'track':<20}{before.wheel_separation_multiplier:<12.5f}"
        f"{after.wheel_separation_multiplier:<12.5f}{_percent(fit.std.track)}"
    )
    if sideways is not None:
        lines.append(
            f"{'sideways':<20}{before.sideways_multiplier or 1.0:<12.5f}"
            f"{sideways.factor:<12.5f}{_percent(sideways.std)}"
        )
    if after.break_away_linear_m_s is not None and after.break_away_angular_rad_s is not None:
        lines.append(
            f"Begins to drive at {after.break_away_linear_m_s:g} m/s, and to turn at "
            f"{after.break_away_angular_rad_s:g} rad/s."
        )
    lines.append(f"{'right over left':<32}{fit.factors.ratio:<12.5f}{_percent(fit.std.ratio)}")
    lines.append(f"Remaining errors: {calibration.residual}.")
    return "\n".join(lines)


def _percent(std: float) -> str:
    return f"{std:.3%}" if std else "not measured"


def _facts(
    fit: Fit, calibration: Calibration, wrong: list[str], written: Path | None
) -> dict[str, Any]:
    return {
        **calibration.as_data(),
        "std": dict(zip(fit.std._fields, fit.std, strict=True)),
        "chi_squared": fit.chi_squared,
        "errors": fit.errors,
        "refused": wrong,
        "written": None if written is None else str(written),
    }
