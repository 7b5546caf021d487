"""SIGTERM and SIGHUP as ordinary ends of a program, so that its robot is stopped on the way out.

By default both kill a process at once. Unless the program handles them, its main thread gets a
``SystemExit`` instead, as Ctrl-C gives it a ``KeyboardInterrupt``. In asyncio the tasks that
entered are cancelled first; the last of them to leave raises it, which ends the event loop.
"""

from __future__ import annotations

import asyncio
import signal
import threading
from types import FrameType

NUMBERS = (signal.SIGTERM, signal.SIGHUP) if hasattr(signal, "SIGHUP") else ()
"""Windows ends a process without asking it; only Ctrl-C is a signal there, too."""

_entered: list[Endings] = []
"""The endings of asyncio programs; all in the main thread, which alone receives signals."""


class Endings:
    """The signal handlers of one entered robot."""

    def __init__(self) -> None:
        self.task: asyncio.Task[object] | None = None
        self.installed: list[signal.Signals] = []
        self.loop: asyncio.AbstractEventLoop | None = None
        self.came: int | None = None

    def begin_async(self) -> None:
        """Cancel the current task on a signal; does nothing outside of the main thread."""
        task = asyncio.current_task()
        if task is None or threading.current_thread() is not threading.main_thread():
            return
        self.loop, self.task = asyncio.get_running_loop(), task
        _entered.append(self)

        def ended(number: int) -> None:
            for each in self._beside():
                if each.came is None and each.task is not None:
                    each.came = number
                    each.task.cancel()

        for number in _unhandled():
            self.loop.add_signal_handler(number, ended, number)
            self.installed.append(number)

    def begin_plain(self) -> None:
        """Raise ``SystemExit`` in the main thread; does nothing outside of it."""
        if threading.current_thread() is not threading.main_thread():
            return

        def ended(number: int, _frame: FrameType | None) -> None:
            if self.came is None:
                self.came = number
                raise SystemExit(128 + number)

        for number in _unhandled():
            signal.signal(number, ended)
            self.installed.append(number)

    def end(self) -> None:
        """Restore the handlers from before.

        Raises:
            SystemExit: A signal came, and the task was cancelled for it.
        """
        if self in _entered:
            _entered.remove(self)
        if beside := self._beside():
            beside[0].installed += self.installed
            self.installed.clear()
            return
        for number in self.installed:
            if self.loop is not None:
                self.loop.remove_signal_handler(number)
            else:
                signal.signal(number, signal.SIG_DFL)
        self.installed.clear()
        if self.loop is not None and self.came is not None:
            raise SystemExit(128 + self.came)

    def _beside(self) -> list[Endings]:
        """The endings that are entered in the same event loop."""
        return [] if self.loop is None else [it for it in _entered if it.loop is self.loop]


def _unhandled() -> list[signal.Signals]:
    return [number for number in NUMBERS if signal.getsignal(number) is signal.SIG_DFL]


def shorten(error: KeyboardInterrupt) -> None:
    """Cut this library's own frames from the traceback; the program's lines remain."""
    step = error.__traceback__
    while step is not None and step.tb_next is not None:
        if step.tb_next.tb_frame.f_globals.get("__package__") == __package__:
            step.tb_next = None
        step = step.tb_next
