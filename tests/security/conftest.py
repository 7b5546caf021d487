"""An authority with its certificates, a daemon behind a Zenoh file, and clients with papers."""

from __future__ import annotations

import json
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import zenoh
from real_robot import RealRobot, free_endpoint, wait_for

EXAMPLES = Path(__file__).parents[2] / "examples"

DRIVE = b'{"vx": 0.3, "wz": 0.0}'


class Authority:
    """Signs certificates, as docs/security.md shows it with openssl."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        folder.mkdir(exist_ok=True)
        self._run("req", "-x509", *_KEY, "-keyout", "ca.key", "-out", "ca.pem", "-days", "3650",
                  "-subj", "/CN=robots of this house")  # fmt: skip

    def sign(self, name: str, addresses: str = "") -> None:
        """Make NAME.pem and NAME.key."""
        self._run("req", *_KEY, "-keyout", f"{name}.key", "-out", f"{name}.csr",
                  "-subj", f"/CN={name}")  # fmt: skip
        extension = f"subjectAltName={addresses}" if addresses else "extendedKeyUsage=clientAuth"
        (self.folder / f"{name}.ext").write_text(f"{extension}\n")
        issue = ["-in", f"{name}.csr", "-out", f"{name}.pem", "-extfile", f"{name}.ext"]
        sign = ["-CA", "ca.pem", "-CAkey", "ca.key", "-CAcreateserial", "-days", "825"]
        self._run("x509", "-req", *issue, *sign)

    def path(self, name: str) -> str:
        return str(self.folder / name)

    def shown_by(self, name: str) -> dict[str, Any]:
        """The options with which a client shows the certificate of a name."""
        return {
            "transport/link/tls/root_ca_certificate": self.path("ca.pem"),
            "transport/link/tls/enable_mtls": True,
            "transport/link/tls/connect_certificate": self.path(f"{name}.pem"),
            "transport/link/tls/connect_private_key": self.path(f"{name}.key"),
        }

    def _run(self, *arguments: str) -> None:
        subprocess.run(["openssl", *arguments], cwd=self.folder, check=True, capture_output=True)


_KEY = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes")


class Client:
    """An application with or without papers; opening it raises if it is refused."""

    def __init__(self, endpoint: str, settings: dict[str, Any]) -> None:
        config = zenoh.Config()
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", json.dumps([endpoint]))
        config.insert_json5("scouting/multicast/enabled", "false")
        for key, value in settings.items():
            config.insert_json5(key, json.dumps(value))
        self.session = zenoh.open(config)
        self.poses: list[dict[str, Any]] = []
        self.session.declare_subscriber("yahboomd/pose", self._hear)

    def _hear(self, sample: zenoh.Sample) -> None:
        self.poses.append(json.loads(bytes(sample.payload)))

    def sees_poses(self) -> None:
        """Wait for fresh ones."""
        count = len(self.poses)
        wait_for(lambda: len(self.poses) > count + 3, "poses")

    def drive(self, for_s: float = 1.0) -> None:
        for _ in range(round(for_s / 0.05)):
            self.session.put("cmd_vel", DRIVE)
            time.sleep(0.05)

    def drive_until(self, condition: Callable[[], Any], what: str) -> None:
        """Drive until something is true."""

        def found() -> bool:
            self.drive(0.05)
            return bool(condition())

        wait_for(found, what)

    def ask(
        self, key: str, payload: bytes | None = None, *, within_s: float = 60.0
    ) -> list[dict[str, Any]]:
        """All answers of a service."""
        replies = self.session.get(key, payload=payload, timeout=within_s)
        return [json.loads(bytes(reply.ok.payload)) for reply in replies if reply.ok is not None]

    def is_refused(self, key: str, payload: bytes | None = None) -> bool:
        """Whether the question is not let through: no answer comes."""
        return self.ask(key, payload, within_s=2.0) == []

    def close(self) -> None:
        self.session.close()


@pytest.fixture(scope="session")
def authority(tmp_path_factory: pytest.TempPathFactory) -> Authority:
    """One that has signed for a robot, an operator, a viewer, `yahboomd moves` and a stranger."""
    made = Authority(tmp_path_factory.mktemp("authority"))
    made.sign("robot", "DNS:localhost,IP:127.0.0.1")
    for name in ("operator", "viewer", "moves", "stranger"):
        made.sign(name)
    return made


@pytest.fixture
def guarded(real_robot: Callable[..., RealRobot], tmp_path: Path) -> Callable[..., RealRobot]:
    """Starts a robot behind a Zenoh file: ``guarded(text, "tls")``; its endpoint is set.

    More endpoints to listen on may follow.
    """

    def start(zenoh_file: str, protocol: str, *more: str, natively: bool = False) -> RealRobot:
        path = tmp_path / "zenoh.json5"
        path.write_text(zenoh_file)
        endpoint = free_endpoint().replace("tcp/127.0.0.1", f"{protocol}/localhost")
        listen = json.dumps([endpoint, *more])
        sets = [f"zenoh.listen={listen}", f"zenoh.config={path}"]
        sets += ["ros2.rmw_zenoh=true"] if natively else []
        robot = real_robot(run=[part for each in sets for part in ("--set", each)])
        robot.endpoint = endpoint
        robot.daemon.says("Connected")
        return robot

    return start


@pytest.fixture
def app() -> Iterator[Callable[..., Client]]:
    """Opens applications: ``app(endpoint, {setting: value})``."""
    clients: list[Client] = []

    def make(endpoint: str, settings: dict[str, Any] | None = None) -> Client:
        clients.append(Client(endpoint, settings or {}))
        return clients[-1]

    yield make
    for each in clients:
        each.close()


@pytest.fixture
def example() -> Callable[..., str]:
    """An example file with its placeholder path replaced: ``example("zenoh-mtls.json5", …)``."""

    def read(name: str, **replacements: str) -> str:
        text = (EXAMPLES / name).read_text()
        for found, wanted in replacements.items():
            standing = f"/etc/yahboomd/{found.replace('_', '.')}"
            assert standing in text
            text = text.replace(standing, wanted)
        assert "/etc/yahboomd/" not in text.replace("/etc/yahboomd/zenoh.json5", "")
        return text

    return read
