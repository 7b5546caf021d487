"""A real ustreamer, fed by a camera that is none: stripes that move, from moving_camera.c."""

from __future__ import annotations

import shutil
import signal
import subprocess
from pathlib import Path

import pytest
from real_robot import free_endpoint, wait_for

SOURCE = Path(__file__).with_name("moving_camera.c")


class UStreamer:
    """Debian's ustreamer; skips the test if it or a compiler is missing.

    Args:
        folder: For its camera and its log.
    """

    def __init__(self, folder: Path) -> None:
        for program in ("ustreamer", "gcc"):
            if shutil.which(program) is None:
                pytest.skip(f"there is no {program} here: make browser installs it")
        self._library = folder / "moving_camera.so"
        subprocess.run(
            ["gcc", "-O2", "-shared", "-fPIC", "-o", self._library, SOURCE, "-ldl"], check=True
        )
        self._device = folder / "camera"
        self._log = folder / "ustreamer.log"
        self.port = int(free_endpoint().rsplit(":", 1)[1])
        self.address = f"http://127.0.0.1:{self.port}/stream"
        self.plug()
        self.start()

    def plug(self) -> None:
        """Plug the camera in."""
        self._device.touch()

    def unplug(self) -> None:
        """Unplug it: ustreamer goes on, with a picture that says so."""
        self._device.unlink()

    def start(self) -> None:
        """Start (another) ustreamer on the same port."""
        with self._log.open("w") as log:
            self.process = subprocess.Popen(
                [
                    *("setpriv", "--pdeathsig", "KILL"),
                    *("env", f"TEST_CAMERA={self._device}", f"LD_PRELOAD={self._library}"),
                    *("ustreamer", "--device", self._device, "--port", str(self.port)),
                ],
                stdout=log,
                stderr=log,
            )
        wait_for(lambda: "HTTP eventloop" in self.log(), "ustreamer serves")

    def log(self) -> str:
        """What it wrote."""
        return self._log.read_text()

    def clients(self) -> int:
        """The number of its clients."""
        _, _, last = self.log().rpartition("clients now: ")
        return int(last.split()[0]) if last != self.log() else 0

    def freeze(self) -> None:
        """Have it send nothing, with its connections open."""
        self.process.send_signal(signal.SIGSTOP)

    def thaw(self) -> None:
        """Let it go on."""
        self.process.send_signal(signal.SIGCONT)

    def close(self) -> None:
        """End it."""
        self.thaw()
        self.process.kill()
        self.process.wait()
