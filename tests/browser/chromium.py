"""Debian's Chromium without a window, driven over its debugging protocol.

The protocol is JSON over a WebSocket: https://chromedevtools.github.io/devtools-protocol/
"""

from __future__ import annotations

import base64
import itertools
import json
import os
import queue
import shutil
import signal
import subprocess
import threading
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from real_robot import wait_for
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

ARGUMENTS = (
    "--headless=new",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
    "--no-proxy-server",
    "--remote-debugging-port=0",
    # A name of this machine from which a page is not secure without TLS, as on a phone.
    "--host-resolver-rules=MAP robot.test 127.0.0.1",
)
ANSWER_S = 60.0

KEYS = {
    "ArrowUp": ("ArrowUp", 38),
    "ArrowDown": ("ArrowDown", 40),
    "ArrowLeft": ("ArrowLeft", 37),
    "ArrowRight": ("ArrowRight", 39),
    "KeyW": ("w", 87),
    "Space": (" ", 32),
    "Enter": ("Enter", 13),
    "Tab": ("Tab", 9),
}
"""Keys by their code: the key's name and its Windows number."""


class BrowserError(Exception):
    """The browser refused an order, or a script on the page raised."""


def chromium_program() -> str:
    """The browser; skips the test if it is missing."""
    for name in ("chromium", "chromium-browser", "google-chrome"):
        if found := shutil.which(name):
            return found
    pytest.skip("there is no chromium here: make browser installs it")


class Chromium:
    """A browser with a profile of its own.

    Args:
        folder: For its profile and its log.
    """

    def __init__(self, folder: Path) -> None:
        profile = folder / "profile"
        self._log = (folder / "chromium.log").open("w")
        # Root has no sandbox.
        root = ["--no-sandbox"] if os.geteuid() == 0 else []
        self.process = subprocess.Popen(
            [
                # It ends with the tests, however they end.
                *("setpriv", "--pdeathsig", "KILL"),
                # More of a busy machine, where we may: the page is tested, not the machine.
                *("nice", "-n", "-5"),
                chromium_program(),
                *ARGUMENTS,
                *root,
                f"--user-data-dir={profile}",
            ],
            stdout=self._log,
            stderr=self._log,
            start_new_session=True,
        )
        port_file = profile / "DevToolsActivePort"
        wait_for(lambda: _lines(port_file) or self.process.poll() is not None, "chromium starts")
        assert self.process.poll() is None, (folder / "chromium.log").read_text()
        port, path = _lines(port_file)
        self._ending = ExitStack()
        self._socket = self._ending.enter_context(
            connect(
                f"ws://127.0.0.1:{port}{path}",
                max_size=None,
                compression=None,
                open_timeout=ANSWER_S,
                # A browser that is paused answers no ping.
                ping_interval=None,
            )
        )
        self._numbers = itertools.count(1)
        self._answers: dict[int, queue.SimpleQueue[dict[str, Any]]] = {}
        self.events: list[dict[str, Any]] = []
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        try:
            for text in self._socket:
                message = json.loads(text)
                if "id" in message:
                    self._answers.pop(message["id"]).put(message)
                else:
                    self.events.append(message)
        except ConnectionClosed:
            pass

    def order(self, method: str, session: str | None = None, **parameters: Any) -> dict[str, Any]:
        """Carry out one order of the protocol; its result."""
        return self.begin(method, session, **parameters)()

    def begin(
        self, method: str, session: str | None = None, **parameters: Any
    ) -> Callable[[], dict[str, Any]]:
        """Send an order; the returned function waits for its result."""
        number = next(self._numbers)
        answers: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
        self._answers[number] = answers
        message = {"id": number, "method": method, "params": parameters}
        self._socket.send(json.dumps(message | ({"sessionId": session} if session else {})))

        def result() -> dict[str, Any]:
            try:
                answer = answers.get(timeout=ANSWER_S)
            except queue.Empty:
                raise BrowserError(f"{method} was never answered") from None
            if "error" in answer:
                raise BrowserError(f"{method}: {answer['error']}")
            found: dict[str, Any] = answer["result"]
            return found

        return result

    def open(
        self,
        url: str,
        *,
        width: int = 360,
        height: int = 740,
        phone: bool = True,
        apart: bool = False,
    ) -> Page:
        """Open a page in a tab of its own; it has the focus.

        Args:
            apart: With cookies of its own, as on another phone.
        """
        context = (
            {"browserContextId": self.order("Target.createBrowserContext")["browserContextId"]}
            if apart
            else {}
        )
        made = self.order("Target.createTarget", url="about:blank", **context)["targetId"]
        page = Page(self, made)
        page.resize(width, height, phone=phone)
        page.go(url)
        return page

    def pause(self) -> None:
        """No process of it runs, as in a laptop asleep."""
        os.killpg(self.process.pid, signal.SIGSTOP)

    def resume(self) -> None:
        """They run again."""
        os.killpg(self.process.pid, signal.SIGCONT)

    def close(self) -> None:
        """End it."""
        self.resume()
        self.process.terminate()
        try:
            self.process.wait(20)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self._ending.close()
        self._reader.join()
        self._log.close()


class Page:
    """A tab.

    Args:
        browser: Which it is in.
        target: The browser's name for it.
    """

    def __init__(self, browser: Chromium, target: str) -> None:
        self.browser = browser
        self.target = target
        self._touched = False
        attached = browser.order("Target.attachToTarget", targetId=target, flatten=True)
        self.session: str = attached["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.order(f"{domain}.enable")

    def order(self, method: str, **parameters: Any) -> dict[str, Any]:
        """An order of the protocol to this tab."""
        return self.browser.order(method, self.session, **parameters)

    def begin(self, method: str, **parameters: Any) -> Callable[[], dict[str, Any]]:
        """The same, without waiting for the result."""
        return self.browser.begin(method, self.session, **parameters)

    # Looks.

    def resize(self, width: int, height: int, *, phone: bool) -> None:
        """Be a phone with a touch screen, or a desktop with a mouse."""
        self.order(
            "Emulation.setDeviceMetricsOverride",
            width=width, height=height, deviceScaleFactor=2 if phone else 1, mobile=phone,
        )  # fmt: skip
        self.order("Emulation.setTouchEmulationEnabled", enabled=phone, maxTouchPoints=5)

    def prefer(self, scheme: str, *, reduced_motion: bool = False) -> None:
        """Prefer a light or dark page."""
        motion = "reduce" if reduced_motion else "no-preference"
        self.order(
            "Emulation.setEmulatedMedia",
            features=[
                {"name": "prefers-color-scheme", "value": scheme},
                {"name": "prefers-reduced-motion", "value": motion},
            ],
        )

    def picture(self, path: Path) -> None:
        """Keep a picture of the page."""
        data = self.order("Page.captureScreenshot", format="png")["data"]
        path.write_bytes(base64.b64decode(data))

    # Contents of the page.

    def go(self, url: str) -> None:
        """Load a page, and wait until it has loaded."""
        self.order("Page.navigate", url=url)
        self.until("document.readyState === 'complete' && location.href !== 'about:blank'")

    def evaluate(self, expression: str) -> Any:
        """The value of an expression, of a promise when it is kept."""
        answer = self.order(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True
        )
        if "exceptionDetails" in answer:
            raise BrowserError(f"{expression}: {answer['exceptionDetails']}")
        return answer["result"].get("value")

    def until(self, expression: str, patience_s: float = 60.0) -> Any:
        """Wait until an expression is true."""

        def value() -> Any:
            try:
                return self.evaluate(expression)
            except BrowserError:
                return None  # The page is between two documents.

        try:
            return wait_for(value, expression, patience_s)
        except pytest.fail.Exception:
            print(f"The page shows:\n{self.text('body')}\n{self.problems()}")
            raise

    def text(self, selector: str) -> str:
        """The text that is seen in an element."""
        found: str = self.evaluate(f"document.querySelector({json.dumps(selector)}).innerText")
        return found

    def says(self, selector: str, words: str) -> None:
        """Wait until an element shows some words."""
        quoted = json.dumps(selector)
        self.until(f"document.querySelector({quoted})?.innerText.includes({json.dumps(words)})")

    def says_driving(self) -> bool:
        """Whether the robot's page shows that it drives."""
        return self.text(".words").startswith("Driving")

    def middle(self, selector: str) -> tuple[float, float]:
        """The middle of an element that is seen."""
        box = self.until(
            f"(() => {{ const b = document.querySelector({json.dumps(selector)})"
            "?.getBoundingClientRect(); return b?.width ? [b.x + b.width / 2, b.y + b.height / 2]"
            " : null; })()"
        )
        return box[0], box[1]

    def problems(self) -> list[str]:
        """The browser's complaints: exceptions, refused sources, failed requests."""
        found = []
        for event in self.browser.events:
            if event.get("sessionId") != self.session:
                continue
            if event["method"] == "Runtime.exceptionThrown":
                found.append(str(event["params"]["exceptionDetails"]))
            if event["method"] == "Log.entryAdded" and event["params"]["entry"]["level"] == "error":
                text = event["params"]["entry"]["text"]
                # An emergency stop that the robot did not acknowledge in time: it is tried again.
                if "503" not in text:
                    found.append(text)
        return found

    # Fingers, mouse and keys.

    def touch(self, *points: tuple[float, float], kind: str = "touchStart") -> None:
        """Fingers are at these points now; all of them, each with its number."""
        self._touched = True
        self.order("Input.dispatchTouchEvent", type=kind, touchPoints=_points(points))

    def lift(self) -> None:
        """Lift all fingers, if there are any."""
        if not self._touched:
            return
        self._touched = False
        self.order("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])

    def tap(self, selector: str) -> None:
        """Touch the middle of an element, and let go."""
        self.touch(self.middle(selector))
        self.lift()

    def click(self, selector: str) -> None:
        """Click an element, wherever it is: a slow machine makes a long press of a tap."""
        self.middle(selector)
        self.evaluate(f"document.querySelector({json.dumps(selector)}).click()")

    def key(self, code: str, *, down: bool) -> None:
        """Press a key, or let it go."""
        key, number = KEYS[code]
        text = {"Enter": "\r", "Space": " "}.get(code, "")
        self.order(
            "Input.dispatchKeyEvent",
            type="keyDown" if down and text else "rawKeyDown" if down else "keyUp",
            code=code, key=key, windowsVirtualKeyCode=number, text=text if down else "",
        )  # fmt: skip

    def type(self, code: str) -> None:
        """Press a key, and let it go."""
        self.key(code, down=True)
        self.key(code, down=False)

    def close(self) -> None:
        """Close the tab."""
        self.browser.order("Target.closeTarget", targetId=self.target)


def _points(points: Sequence[tuple[float, float]]) -> list[dict[str, float]]:
    return [{"x": x, "y": y, "id": number} for number, (x, y) in enumerate(points)]


def _lines(path: Path) -> list[str]:
    try:
        lines = path.read_text().split()
    except OSError:
        return []
    return lines if len(lines) == 2 else []
