"""Which signals are handled, by name and by fate."""

from __future__ import annotations

import asyncio
import signal

from yahboomd.daemon.signals import ENDING, KILLING, SUSPENDING, Signals, name_of


def test_every_signal_is_handled_that_can_be_and_would_end_or_suspend_the_process() -> None:
    left = signal.valid_signals() - {*ENDING, *KILLING, *SUSPENDING}
    assert {signal.Signals(each).name for each in left} == {
        *("SIGKILL", "SIGSTOP"),
        *("SIGCHLD", "SIGCONT", "SIGURG", "SIGWINCH"),
        *("SIGABRT", "SIGBUS", "SIGFPE", "SIGILL", "SIGSEGV"),
    }


def test_signals_without_a_name_of_their_own_have_one() -> None:
    assert name_of(signal.SIGQUIT) == "SIGQUIT"
    assert name_of(signal.SIGRTMIN + 3) == "SIGRTMIN+3"


async def test_a_signal_that_is_ignored_stays_ignored() -> None:
    """As it is for a program that a script started in the background."""
    before = signal.signal(signal.SIGQUIT, signal.SIG_IGN)
    asked: list[str] = []
    signals = Signals(asked.append)
    try:
        signals.install()
        signal.raise_signal(signal.SIGQUIT)
        signal.raise_signal(signal.SIGUSR1)
        signal.raise_signal(signal.SIGUSR2)
        while len(asked) < 2:
            await asyncio.sleep(0.001)
        assert asked == ["SIGUSR1", "SIGUSR2"]
        # The first one decides.
        assert signals.fatal == signal.SIGUSR1
    finally:
        signals.remove()
        signal.signal(signal.SIGQUIT, before)
    assert signal.getsignal(signal.SIGUSR1) is signal.SIG_DFL
    assert signal.getsignal(signal.SIGTSTP) is signal.SIG_DFL


async def test_continuing_before_the_wheels_stand_takes_a_suspension_back() -> None:
    signals = Signals(lambda _name: None)
    signals.at_once = False
    try:
        signals.install()
        signal.raise_signal(signal.SIGTSTP)
        await signals.suspend.wait()
        # Meanwhile more of them change nothing.
        assert signal.getsignal(signal.SIGTTOU) is signal.SIG_IGN
        signal.raise_signal(signal.SIGCONT)
        while signals.suspend.is_set():
            await asyncio.sleep(0.001)
        signal.raise_signal(signal.SIGTTOU)
        await signals.suspend.wait()
    finally:
        signals.remove()
