"""Errors of a line that damages bytes: readings over it prove nothing about the wheels."""

from __future__ import annotations

import contextlib
from collections.abc import AsyncIterator
from typing import Self

from yahboomd.core.errors import BoardError, BoardSilent
from yahboomd.core.link.line import Line
from yahboomd.core.protocol.dialect import Dialect


class LineFault(BoardError):
    """The line damages too many bytes to measure."""

    @classmethod
    def of(cls, line: Line) -> Self:
        """Make the error for a line."""
        return cls(
            f"{line.port.name}: the line to the board loses or alters bytes in too many steps: "
            "nothing is measured, and the motors were cut.",
            remedy="Check the USB cable, its shield and its distance from the motors' wires, then "
            "tune again.",
        )


@contextlib.asynccontextmanager
async def line_blamed(line: Line, dialect: Dialect) -> AsyncIterator[None]:
    """Turn an error of the body into one of the line if the line damages bytes.

    Raises:
        BoardError: The line is to blame.
    """
    try:
        yield
    except (BoardError, BoardSilent) as error:
        # Time for damage on the line to show.
        await line.rest(dialect)
        if not line.noisy or isinstance(error, LineFault):
            raise
        raise BoardError(
            f"{line.port.name}: the line to the board loses or alters bytes, so nothing is known "
            "of the wheels; the motors were cut. Check the USB cable, its shield and its distance "
            f"from the motors' wires, then tune again. If it goes on: {error.message}",
            remedy=error.remedy,
        ) from error
