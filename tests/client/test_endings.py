from __future__ import annotations

import asyncio
import os
import signal
import subprocess
import sys
import threading

import pytest

from yahboomd.client.endings import Endings


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
async def test_a_signal_cancels_the_task_and_ends_the_process_afterwards(number: int) -> None:
    endings = Endings()
    endings.begin_async()
    os.kill(os.getpid(), number)
    with pytest.raises(asyncio.CancelledError):
        await asyncio.Event().wait()
    asyncio.current_task().uncancel()
    with pytest.raises(SystemExit) as caught:
        endings.end()
    assert caught.value.code == 128 + number
    assert signal.getsignal(number) is signal.SIG_DFL


def test_without_asyncio_a_signal_raises_once() -> None:
    endings = Endings()
    endings.begin_plain()
    try:
        with pytest.raises(SystemExit):
            signal.raise_signal(signal.SIGTERM)
        signal.raise_signal(signal.SIGTERM)
    finally:
        endings.end()
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


def test_a_handler_of_the_program_stays() -> None:
    def handler(*_: object) -> None:
        pass

    before = signal.signal(signal.SIGTERM, handler)
    try:
        endings = Endings()
        endings.begin_plain()
        assert signal.getsignal(signal.SIGTERM) is handler
        endings.end()
        assert signal.getsignal(signal.SIGTERM) is handler
    finally:
        signal.signal(signal.SIGTERM, before)


def test_in_another_thread_nothing_is_installed() -> None:
    endings = Endings()
    thread = threading.Thread(target=endings.begin_plain)
    thread.start()
    thread.join()
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
    endings.end()


@pytest.mark.nightly
def test_a_process_ends_with_the_status_of_its_signal() -> None:
    code = (
        "import signal\nfrom yahboomd.client.endings import Endings\n"
        "Endings().begin_plain()\nsignal.raise_signal(signal.SIGTERM)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 143
