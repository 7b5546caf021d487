"""The command as a process, on a real daemon with the simulated board."""

from __future__ import annotations

from collections.abc import Callable
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
    # A page of a busy machine takes longer than a command lasts.
    robot = real_robot(run=["--set", "command.timeout_s=30.0"])
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


@pytest.mark.parametrize("place", ["0.0.0.0:0", "[::]:0", "192.168.1.5:9448"])
def test_what_other_machines_would_reach_is_refused_with_the_reason(
    capsys: pytest.CaptureFixture[str], place: str
) -> None:
    assert main(["metrics", "--listen", place]) == 78
    said = capsys.readouterr().err
    assert "every program on the network could read the metrics" in said
    assert "--expose" in said


@pytest.mark.nightly
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


def test_two_robots_of_one_name_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["metrics", "--namespace", "bot1", "--namespace", "bot1"]) == 78
    assert "'bot1'" in capsys.readouterr().err
