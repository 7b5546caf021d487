"""Calibrates a robot: called by the command, and by the page."""

from __future__ import annotations

import asyncio
from functools import partial
from typing import TYPE_CHECKING

from yahboomd.core.bus import keys
from yahboomd.core.errors import ConfigError, Refused
from yahboomd.tools.calibrate.choices import HandTurns, TapeRuns

if TYPE_CHECKING:
    from yahboomd.client import AsyncRobot
    from yahboomd.core.clock import Clock
    from yahboomd.core.config import Config, Loaded
    from yahboomd.tools.calibrate.choices import Choices
    from yahboomd.tools.calibrate.estimates.least_squares import Fit
    from yahboomd.tools.calibrate.estimates.sideways import Sideways, SidewaysRun
    from yahboomd.tools.calibrate.hold import HeldButton
    from yahboomd.tools.terminal.asking import Person

CONFIG_WITHIN_S = 8.0
"""A daemon that does not answer for this time does not run."""


async def calibrate(
    robot: AsyncRobot,
    loaded: Loaded,
    choices: Choices,
    person: Person,
    hold: HeldButton | None = None,
    *,
    source: str = keys.CMD_VEL,
    clock: Clock | None = None,
) -> None:
    """Ask, drive, fit, and write the result.

    A cancellation stops the robot. Fits and files take their time in threads, so that the caller's
    loop serves others meanwhile.

    Args:
        loaded: The configuration of this machine, which names the calibration file.
        hold: The button that lets the robot move; None: an answer starts each movement.
        source: The key on which the robot commands.

    Raises:
        Refused: The result cannot be trusted, or the robot does not obey.
        NoDaemon: The daemon was lost.
        ConfigError: The daemon is another robot's, or the file cannot be written.
    """
    if isinstance(choices, HandTurns):
        from yahboomd.client import ImuSample, StatusSample
        from yahboomd.core.protocol.registry import DIALECTS
        from yahboomd.tools.calibrate.imu_by_hand import show_mounted, turn_by_hand

        config = await config_of(robot, loaded)
        status = await robot.get(StatusSample)
        name = "" if status is None else str(status.board.get("imu"))
        sensors = [each for dialect in DIALECTS.values() for each in dialect.sensors]
        usual = [each.axes for each in sensors if each.name == name] or ["x y z"]
        imu = config.imu.model_copy(update={"axes": config.imu.axes or usual[0]})
        config = config.model_copy(update={"imu": imu})
        stream = partial(robot.samples, ImuSample, depth=1024)
        show_mounted(await turn_by_hand(stream, person, config, choices.turns), config, person)
        return
    # Both before the robot moves: numpy belongs to an extra, and may be missing.
    await asyncio.to_thread(_import_fits)
    if not choices.dry_run and loaded.calibration_path is not None:
        from yahboomd.tools.calibrate.calibration_writing import check_writable

        check_writable(loaded.calibration_path)
    from yahboomd.tools.calibrate.estimates.least_squares import PARTS, Unseen, fit
    from yahboomd.tools.calibrate.estimates.runs import Factors
    from yahboomd.tools.calibrate.estimates.sideways import fit_sideways
    from yahboomd.tools.calibrate.estimates.verdict import unseen
    from yahboomd.tools.calibrate.result import conclude, ratio_of
    from yahboomd.tools.calibrate.shapes import LegDriver
    from yahboomd.tools.calibrate.wizard import MeasuredRuns

    config = await config_of(robot, loaded)
    holonomic = config.kinematics().holonomic
    if holonomic and not isinstance(choices, TapeRuns):
        raise Refused(
            "A mecanum base is calibrated by tape: its slip hides the ratio of the wheels. "
            "`yahboomd calibrate tape`"
        )
    driver = LegDriver(robot, config, source, hold, clock)
    measured = MeasuredRuns(driver, person, choices)
    beside: list[SidewaysRun] = []
    if isinstance(choices, TapeRuns):
        if holonomic:
            # Before the turns: wheels that are mounted mirrored do not turn it.
            beside = await measured.sideways(choices.sideways_m)
        # The rollers of a mecanum base bend it, too.
        runs = await measured.by_tape(choices, bend=not holonomic)
        bent = any(run.kind == "pose" for run in runs)
        method, free = "tape", PARTS if bent else PARTS[::2]
    else:
        runs = await measured.by_squares(choices)
        method, free = f"squares of {choices.side_m:g} m", PARTS

    def fitted() -> tuple[Fit, Sideways | None]:
        # Without a measured bend a tape does not show the ratio: keep the one found by squares.
        found = fit(runs, free=free, start=Factors(ratio=ratio_of(config)))
        if not beside:
            return found, None
        scale, track, std = found.factors.scale, found.factors.track, found.std.scale
        return found, fit_sideways(beside, scale=scale, track=track, scale_std=std)

    try:
        found, to_the_side = await asyncio.to_thread(fitted)
    except Unseen as error:
        raise Refused(f"Nothing was written. {unseen(error)}") from error
    await conclude(
        found,
        config,
        loaded.calibration_path,
        method=method,
        runs=runs,
        sideways=to_the_side,
        sideways_runs=beside,
        break_away=driver.break_away,
        dry_run=choices.dry_run,
        person=person,
    )


def _import_fits() -> None:
    import yahboomd.tools.calibrate.wizard  # noqa: F401


async def config_of(robot: AsyncRobot, loaded: Loaded) -> Config:
    """The daemon's configuration; this machine's calibration file has to belong to it.

    Raises:
        ConfigError: It is another robot's, or another version's.
    """
    from yahboomd.core.config import read_foreign
    from yahboomd.core.config.calibration_file import geometry_of

    answer = await robot.call(keys.CONFIG, timeout_s=CONFIG_WITHIN_S)
    config = read_foreign(answer.data, "The daemon")
    if geometry_of(config) != geometry_of(loaded.config):
        raise ConfigError(
            "The daemon runs with another robot's configuration than "
            f"{loaded.path or 'the defaults'}, which this command has read.",
            remedy="Name the daemon's own file: `--config FILE`.",
        )
    return config


async def ended(robot: AsyncRobot, choices: Choices) -> str:
    """Stop the robot of a calibration that was cancelled; returns the outcome in words."""
    if isinstance(choices, HandTurns):
        return "Ended: nothing was driven, and nothing was written."
    robot.stop()
    if await robot.standing():
        return "Ended: the wheels were stopped and stand; nothing was written."
    return (
        "Ended: a stop was sent, but the wheels were not seen to stand. Look at them, or run "
        "`yahboomd stop`. Nothing was written."
    )


def undo(loaded: Loaded) -> str:
    """Remove the newest calibration; returns the outcome in words.

    Raises:
        Refused: There is none.
        ConfigError: The folder cannot be written to, or the file is not a calibration.
    """
    from yahboomd.tools.calibrate.calibration_writing import undo_calibration

    path = loaded.calibration_path
    if path is None or not undo_calibration(path):
        raise Refused(f"There is no calibration to take back in {path or 'any state directory'}.")
    return f"Taken back in {path}. The daemon reads it when it starts."
