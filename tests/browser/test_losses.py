"""Losing the thumb, counted; `make browser ARGS="-k losses -rP"` has the table of docs/web.md."""

from __future__ import annotations

import contextlib
import os
import selectors
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
from chromium import Page
from page_bench import PageBench

from yahboomd.web.certificate import CERTIFICATE, KEY, make_certificate

pytestmark = [pytest.mark.realtime, pytest.mark.xdist_group("browser"), pytest.mark.nightly]

TIMES = int(os.environ.get("YAHBOOMD_LOSSES", "5"))
STANDING_M_S = 0.02
PAGES = 64


def listen_only(port: int, cookie: str = "") -> socket.socket:
    """A page that was opened, and of which nothing more is seen."""
    page = socket.socket()
    page.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
    page.connect(("127.0.0.1", port))
    host = f"127.0.0.1:{port}"
    page.sendall(
        f"GET /ws HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\n{cookie}"
        "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n".encode()
    )
    assert b" 101 " in page.recv(64)
    return page


@contextmanager
def readers(port: int, number: int) -> Iterator[None]:
    """So many pages that read all they get, and do no more."""
    ends = threading.Event()
    with ExitStack() as stack, selectors.DefaultSelector() as selector:
        for _ in range(number):
            page = stack.enter_context(contextlib.closing(listen_only(port)))
            selector.register(page, selectors.EVENT_READ)

        def read() -> None:
            while not ends.is_set():
                for key, _ in selector.select(0.1):
                    assert isinstance(key.fileobj, socket.socket)
                    key.fileobj.recv(1 << 16)

        reading = threading.Thread(target=read)
        reading.start()
        yield
        ends.set()
        reading.join()


def counted(bench: PageBench, page: Page, name: str, loss: Callable[[], object]) -> None:
    """Drive, lose the thumb, and look at the wheels: they stop, and nothing turns them again."""
    bench.press(page)
    lost_ns = time.monotonic_ns()
    loss()
    bench.robot.settled_truth()
    bench.stays()
    turned = [
        each.t_ns for each in bench.robot.truth() if max(map(abs, each.speed_m_s)) > STANDING_M_S
    ]
    late_ms = (turned[-1] - lost_ns) / 1e6
    WORST.setdefault(name, []).append(late_ms)
    print(f"| {name} | {len(WORST[name])} of {TIMES} | {max(WORST[name]):.0f} ms |")


WORST: dict[str, list[float]] = {}


def alert(page: Page) -> None:
    page.begin("Runtime.evaluate", expression="alert('A box')")


def no_alert(page: Page) -> None:
    page.order("Page.handleJavaScriptDialog", accept=True)


def hide(page: Page) -> None:
    """Another tab is in front."""
    other = page.browser.order("Target.createTarget", url="about:blank")["targetId"]
    page.until("document.hidden")
    page.browser.order("Target.closeTarget", targetId=other)


def freeze(page: Page) -> None:
    page.order("Page.setWebLifecycleState", state="frozen")


def thaw(page: Page) -> None:
    page.order("Page.setWebLifecycleState", state="active")


def turn(page: Page) -> None:
    """The browser's window itself, not what it pretends to be."""
    window = page.browser.order("Browser.getWindowForTarget", targetId=page.target)["windowId"]
    for width, height in ((700, 500), (500, 700)):
        page.browser.order(
            "Browser.setWindowBounds", windowId=window, bounds={"width": width, "height": height}
        )


def own_size(page: Page) -> None:
    page.order("Emulation.clearDeviceMetricsOverride")


def nothing(_: Page) -> None:
    pass


LOSSES: dict[str, tuple[Callable[[Page], object], Callable[[Page], object]]] = {
    "thumb lifted": (Page.lift, nothing),
    "alert box": (alert, no_alert),
    "another view": (lambda page: page.evaluate("location.hash = '#record'"), nothing),
    "page reloaded": (lambda page: page.order("Page.reload"), nothing),
    "tab hidden": (hide, nothing),
    "tab frozen": (freeze, thaw),
    "browser stopped, as in a computer asleep": (
        lambda page: page.browser.pause(),
        lambda page: page.browser.resume(),
    ),
    "window turned from wide to high": (turn, nothing),
}
"""What loses the thumb, and what ends that again."""


@pytest.mark.parametrize("name", LOSSES)
def test_losses_of_a_page(bench: PageBench, name: str) -> None:
    loss, end = LOSSES[name]
    for _ in range(TIMES):
        with bench.page() as page:
            if loss is turn:
                own_size(page)
            try:
                counted(bench, page, name, lambda page=page: loss(page))
            finally:
                end(page)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_losses_of_the_server(bench: PageBench, number: signal.Signals) -> None:
    kills = number == signal.SIGKILL
    for _ in range(TIMES):
        with bench.page() as page:
            server = bench.server.process
            name = f"server {'killed' if kills else 'stopped'} ({number.name})"
            try:
                counted(bench, page, name, lambda server=server: server.send_signal(number))
            finally:
                page.lift()
                if kills:
                    bench.server.end_by_itself()
                    bench.start_server()
                else:
                    server.send_signal(signal.SIGCONT)
            bench.stays()


@pytest.mark.parametrize("slow", [False, True], ids=["64 pages", "slow reader"])
def test_losses_beside_other_pages(bench: PageBench, slow: bool) -> None:
    for _ in range(TIMES):
        with ExitStack() as stack:
            page = stack.enter_context(bench.page())
            bench.ready(page)
            if slow:
                name = "thumb lifted, beside a page that reads nothing"
                stack.enter_context(contextlib.closing(listen_only(bench.port)))
            else:
                name = "thumb lifted, beside 63 other pages"
                stack.enter_context(readers(bench.port, PAGES - 1))
            counted(bench, page, name, page.lift)


def test_losses_by_a_viewers_stop(make_bench: Callable[..., PageBench]) -> None:
    bench = make_bench(listen="0.0.0.0")
    driver, viewer = bench.links()
    # Cookies are those of a name: two phones need two.
    viewer = viewer.replace("127.0.0.1", "localhost")
    with bench.page(driver) as page, bench.page(viewer) as other:
        page.order("Emulation.setFocusEmulationEnabled", enabled=True)  # Two phones.
        other.says(".words", "watch and stop")
        for _ in range(TIMES):
            # The browser gives the page behind another one little time.
            page.order("Page.bringToFront")
            counted(bench, page, "emergency stop by a viewer", lambda: other.click("#estop"))
            page.lift()
            bench.recover()


def test_losses_over_tls(make_bench: Callable[..., PageBench], tmp_path: Path) -> None:
    make_certificate(tmp_path, ["127.0.0.1"])
    files = ("--certificate", str(tmp_path / CERTIFICATE), "--key", str(tmp_path / KEY))
    bench = make_bench(web=files)
    with bench.page("about:blank#") as page:
        page.order("Security.setIgnoreCertificateErrors", ignore=True)
        for name, loss in (
            ("thumb lifted, TLS", page.lift),
            ("page reloaded, TLS", lambda: page.order("Page.reload")),
            ("network cut, TLS", bench.network.cut),
        ):
            for _ in range(TIMES):
                page.go("about:blank#")
                page.go(bench.url.replace("http:", "https:"))
                counted(bench, page, name, loss)
                page.lift()
                bench.recover()
