"""The tools of a page besides driving: calibrate, record, and ask why the robot stopped."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import msgspec

from yahboomd.client import AsyncRobot
from yahboomd.core.bus.options import BusOptions
from yahboomd.core.clock import Clock
from yahboomd.web.page_boxes import PageBoxes
from yahboomd.web.page_calibration import PageCalibration
from yahboomd.web.page_recordings import PageRecordings
from yahboomd.web.page_session import Tool

if TYPE_CHECKING:
    from yahboomd.core.config import Loaded

CALIBRATION = "yahboomd calibrate"
"""Who commands during a calibration, for people."""

UNKNOWN = "This server does not know that."


class RobotList(Protocol):
    """Other robots, which a page lists and stops: those of a fleet, by the package of that."""

    def shown(self) -> dict[str, Any]:
        """What each robot does, and the progress of a stop, for `page/fleet.js`."""

    def stop(self) -> None:
        """Begin to stop all of them; again if that is under way."""

    async def close(self) -> None:
        """End looking and stopping."""


class ToolSettings(msgspec.Struct, frozen=True, kw_only=True):
    """The surroundings of the commands that pages start.

    Attributes:
        robot: Options with the daemon's address, for every command that talks to it.
        load: Reads the configuration of the robot's machine anew.
        camera: The address of the robot's camera; empty if it has none.
        fleet: The robots of a fleet; None if pages show no other robots.
    """

    robot: tuple[str, ...]
    recordings: Path
    load: Callable[[], Loaded]
    camera: str = ""
    fleet: RobotList | None = None


class PageTools:
    """Calibration, recording and black boxes, which all pages share."""

    def __init__(
        self,
        options: BusOptions,
        clock: Clock,
        settings: ToolSettings,
        source: str,
        show: Callable[[Mapping[str, bytes]], None],
    ) -> None:
        self._show = show
        self.calibration = PageCalibration(
            clock,
            lambda: AsyncRobot(options, source=source, label=CALIBRATION, clock=clock),
            settings.load,
            source,
            changed=self._calibrates,
        )
        self.boxes = PageBoxes(clock, settings.robot)
        self.recordings = PageRecordings(clock, settings.robot, settings.recordings, self._records)

    def shown(self) -> dict[str, bytes]:
        """Everything, for a page that connects."""
        return {"calibration": self.calibration.shown(), "recording": self.recordings.shown()}

    def _calibrates(self) -> None:
        self._show({"calibration": self.calibration.shown()})

    def _records(self) -> None:
        self._show({"recording": self.recordings.shown()})

    async def use(self, page: int, tool: Tool) -> tuple[bool, str]:
        """Carry out a driver's request; returns whether it was done, and a sentence for people."""
        match tool:
            case Tool(do="calibrate", args={"verb": verb, "choices": dict(choices)}):
                words = self.calibration.begin(page, verb, choices)
            case Tool(do="answer", args={"question": question, "text": text}):
                words = self.calibration.answer(page, question, text)
            case Tool(do="end_calibration"):
                words = self.calibration.end(page)
            case Tool(do="undo_calibration"):
                return await self.calibration.undo()
            case Tool(do="save_box"):
                return await self.boxes.save()
            case Tool(do="record"):
                words = await self.recordings.begin()
            case Tool(do="end_recording"):
                words = self.recordings.stop()
            case Tool(do="delete_recording", args={"name": name}):
                words = await self.recordings.delete(name)
            case _:
                words = UNKNOWN
        return not words, words

    async def close(self) -> None:
        """End everything, and wait until it has ended."""
        await self.calibration.close()
        await self.recordings.close()
