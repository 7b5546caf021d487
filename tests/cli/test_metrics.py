"""The command as a process, on a real daemon with the simulated board."""

from __future__ import annotations

import signal
import socket
import urllib.error
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from metrics_exporter import Exporter, Labels, exporter
from real_robot import Client, Process, RealRobot, free_endpoint, wait_for

from yahboomd.cli.main import main
from yahboomd.core.messages.status_fields import FIELDS
from yahboomd.tools.metrics.robot_metrics import metric_name

__all__ = ["exporter"]

pytestmark = pytest.mark.realtime


def group_of(status: dict[str, Any], group: str) -> dict[str, Any]:
    return status["command"]["sources"]["cmd_vel"] if group == "sources" else status[group]


def test_every_number_of_a_real_status_is_on_the_page(
    real_robot: Callable[..., RealRobot],
    client: Callable[..., Client],
    exporter: Callable[..., Exporter],
) -> None:
    robot = real_robot()
    page = exporter("--connect", robot.endpoint)
    application = client("client", robot.endpoint)
    application.in_state("standing")
    application.session.put("cmd_vel", b"nonsense")
    application.drive_until(
        b'{"vx": 0.2}',
        lambda: (page.value("yahboomd_twist_linear_meters_per_second", axis="x") or 0) > 0.15,
        "the page shows a robot that drives",
    )
    application.session.put("yahboomd/estop", b"")
    application.in_state("estopped")
    wait_for(lambda: page.value("yahboomd_estop_engaged") == 1, "the e-stop is on the page")
    labels: Labels = (("robot", "yahboomd"),)
    found = page.series()
    stamp_s = found["yahboomd_status_timestamp_seconds", labels]
    # The page is made from one status, which this application has received, too.
    (status,) = wait_for(
        lambda: [
            each
            for each in application.samples["status"]
            if each["stamp_ns"] / 1e9 == pytest.approx(stamp_s, rel=0.0, abs=1e-5)
        ],
        "the status of the page",
    )
    assert found["yahboomd_unknown_status_fields", labels] == 0
    seen = 0
    for field in FIELDS:
        if field.kind == "text" or field.per:
            continue
        group = group_of(status, field.group)
        if field.name not in group:
            assert field.absent, field.name
            continue
        source = (("source", "cmd_vel"),) if field.group == "sources" else ()
        name = metric_name(field) + ("_total" if field.kind == "counter" else "")
        factor = {"ns": 1e-9, "mm": 1e-3}.get(field.unit, 1)
        expected = pytest.approx(group[field.name] * factor, rel=1e-6)
        assert found[name, (*labels, *source)] == expected, name
        seen += 1
    assert seen > 100
    refused = {"source": "cmd_vel", "reason": "unknown_encoding"}
    assert page.value("yahboomd_source_refused_total", **refused) == 1
    assert page.value("yahboomd_state", state="estopped") == 1
    wait_for(
        lambda: page.value("yahboomd_events_total", kind="estop", severity="warning"), "the event"
    )


def test_a_daemon_that_is_away_is_shown_as_away_at_once_and_comes_back(
    real_robot: Callable[..., RealRobot],
    client: Callable[..., Client],
    exporter: Callable[..., Exporter],
) -> None:
    robot = real_robot()
    page = exporter("--connect", robot.endpoint)
    application = client("client", robot.endpoint)
    application.in_state("standing")
    application.session.put("yahboomd/estop", b"")
    wait_for(lambda: page.value("yahboomd_command_estops_total") == 1, "the e-stop is counted")
    # Suspended, it holds its connection and answers nothing.
    robot.daemon.process.send_signal(signal.SIGSTOP)
    try:
        wait_for(lambda: page.value("yahboomd_up") == 0, "it counts as dead")
        assert page.value("yahboomd_status_age_seconds") > 0.5
        assert page.value("yahboomd_link_readings_total") is None
        assert page.value("yahboomd_state", state="standing") is None
        # It looks once a second: a shorter silence may pass unseen.
        page.process.says("its daemon has gone silent")
    finally:
        robot.daemon.process.send_signal(signal.SIGCONT)
    wait_for(lambda: page.value("yahboomd_up") == 1, "it answers again")
    robot.daemon.end()
    wait_for(lambda: page.value("yahboomd_up") == 0, "it has ended")
    robot.start_daemon()
    wait_for(lambda: page.value("yahboomd_up") == 1, "another one answers")
    # Its counters begin at zero, which Prometheus expects; its e-stop is engaged still.
    wait_for(lambda: page.value("yahboomd_command_estops_total") == 0, "its own counters")
    assert page.value("yahboomd_estop_engaged") == 1


def test_several_robots_are_distinguished(
    real_robot: Callable[..., RealRobot], exporter: Callable[..., Exporter], tmp_path: Path
) -> None:
    robot = real_robot(run=["--set", 'zenoh.namespace="front"'])
    front, rear = tmp_path / "front.toml", tmp_path / "rear.toml"
    for path, endpoint in ((front, robot.endpoint), (rear, free_endpoint())):
        path.write_text(
            f'[zenoh]\nnamespace = "{path.stem}"\nlisten = ["{endpoint}"]\nconnect = []\n'
        )
    page = exporter("--config", str(front), "--config", str(rear))
    wait_for(lambda: page.value("yahboomd_up", "front") == 1, "the front answers")
    assert page.value("yahboomd_up", "rear") == 0
    assert page.value("yahboomd_board_volts", "rear") is None
    with pytest.raises(urllib.error.HTTPError, match="404"):
        urllib.request.urlopen(page.url.replace("/metrics", "/"), timeout=60)


def test_a_flood_of_scrapes_asks_the_daemon_no_more_than_none(
    real_robot: Callable[..., RealRobot], exporter: Callable[..., Exporter]
) -> None:
    robot = real_robot()
    page = exporter("--connect", robot.endpoint)
    wait_for(lambda: page.value("yahboomd_up") == 1, "the daemon answers")

    def asked() -> tuple[float, float]:
        """The stamp of the newest status, and the questions until then."""
        found, key = page.series(), (("robot", "yahboomd"),)
        return (
            found["yahboomd_status_timestamp_seconds", key],
            found["yahboomd_bus_requests_total", key],
        )

    begin_s, begin = end_s, end = asked()
    while end_s < begin_s + 3.0:
        for _ in range(100):
            page.page()
        end_s, end = asked()
    # Two questions a second, for twist and wheels; a scrape adds none. The edges hold two more, and
    # a daemon that was held up for some seconds then reads what waited. A question for each page
    # would be six a second.
    assert end - begin <= 2.0 * (end_s - begin_s) + 8.0


def test_it_ends_in_order(exporter: Callable[..., Exporter]) -> None:
    page = exporter("--connect", free_endpoint())
    assert page.value("yahboomd_up") == 0
    assert page.process.end() == 0
    assert "Traceback" not in page.process.output


@pytest.mark.parametrize("place", ["0.0.0.0:0", "[::]:0", "192.168.1.5:9448"])
def test_what_other_machines_would_reach_is_refused_with_the_reason(
    capsys: pytest.CaptureFixture[str], place: str
) -> None:
    assert main(["metrics", "--listen", place]) == 78
    said = capsys.readouterr().err
    assert "every program on the network could read the metrics" in said
    assert "--expose" in said


def test_it_can_be_exposed_on_purpose(exporter: Callable[..., Exporter]) -> None:
    page = Process("metrics", "--connect", free_endpoint(), "--listen", "0.0.0.0:0", "--expose")
    try:
        page.says("Metrics at http://0.0.0.0:")
    finally:
        assert page.end() == 0


@pytest.mark.parametrize("place", ["9448", "robot.local:9448", "127.0.0.1:x"])
def test_a_place_that_is_none_is_refused(capsys: pytest.CaptureFixture[str], place: str) -> None:
    assert main(["metrics", "--listen", place]) == 78
    assert "127.0.0.1:9448" in capsys.readouterr().err


def test_a_port_that_is_taken_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        place = f"127.0.0.1:{taken.getsockname()[1]}"
        assert main(["metrics", "--listen", place, "--connect", free_endpoint()]) == 69
    assert "cannot be served" in capsys.readouterr().err


def test_two_robots_of_one_name_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["metrics", "--namespace", "bot1", "--namespace", "bot1"]) == 78
    assert "'bot1'" in capsys.readouterr().err


def test_a_bus_that_can_never_be_reached_ends_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    broken = tmp_path / "zenoh.json5"
    broken.write_text("{")
    options = ["--set", f'zenoh.config="{broken}"', "--connect", free_endpoint()]
    assert main(["metrics", "--listen", "127.0.0.1:0", *options]) == 69
    assert "zenoh.json5" in capsys.readouterr().err
