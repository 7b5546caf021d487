"""Calls the parts that only record, publish or show, so that their failure affects nothing else.

Law: an exception of such a part is counted and logged once, and the part is switched off until the
daemon starts again. It reaches neither the control path nor the link nor a stop.
"""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable
from functools import partial
from typing import Any, TypeVar

log = logging.getLogger(__name__)

Result = TypeVar("Result")


class Recorders:
    """The parts of the daemon that nothing depends on, by their names.

    Attributes:
        failures: The number of parts that were switched off.
    """

    def __init__(self) -> None:
        self._off: dict[str, str] = {}
        self.failures = 0

    def call(
        self,
        name: str,
        function: Callable[..., Result],
        /,
        *arguments: object,
        default: Any = None,  # noqa: ANN401 - as the function
        **named: object,
    ) -> Any:  # noqa: ANN401 - what the function returns, or the default
        """Call a part; returns ``default`` if it fails, or is switched off."""
        if self._off and name in self._off:
            return default
        try:
            return function(*arguments, **named)
        except (SystemExit, KeyboardInterrupt):
            raise
        except BaseException as error:  # noqa: BLE001 - a panic of Zenoh's is no Exception
            self._switch_off(name, error)
            return default

    def guarded(self, name: str, function: Callable[..., Result]) -> Callable[..., Any]:
        return partial(self.call, name, function)

    def guard(self, name: str, part: object) -> None:
        for each in dir(part):
            if not each.startswith("_") and callable(method := getattr(part, each)):
                setattr(part, each, self.guarded(name, method))

    def works(self, name: str) -> bool:
        return name not in self._off

    def status_values(self) -> dict[str, Any]:
        off = "; ".join(f"{name}: {words}" for name, words in self._off.items())
        return {"recorder_failures": self.failures, "recorders_off": off}

    def _switch_off(self, name: str, error: BaseException) -> None:
        words = f"{type(error).__name__}: {error}"[:200]
        self._off[name] = words
        self.failures += 1
        with contextlib.suppress(Exception):
            log.error(
                "%s failed and is switched off until yahboomd is started again (%s). The robot "
                "drives and stops as ever. Please report this as a bug.",
                name,
                words,
                exc_info=error,
            )
