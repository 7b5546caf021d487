"""Real Prometheus on a real exporter and a real daemon: the page, the rules and the dashboard.

It needs `prometheus` and `promtool` (apt install prometheus); `make metrics` runs it.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import urllib.parse
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from metrics_exporter import Exporter, exporter
from real_robot import Client, RealRobot, free_endpoint, wait_for

from yahboomd.core.messages.status_fields import FIELDS
from yahboomd.tools.metrics.robot_metrics import PREFIX, metric_name

__all__ = ["exporter"]

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
RULES = EXAMPLES / "prometheus/alerts.yml"
DASHBOARD = json.loads((EXAMPLES / "grafana/yahboomd.json").read_text())

needs_prometheus = pytest.mark.skipif(
    not (shutil.which("prometheus") and shutil.which("promtool")),
    reason="this machine has no prometheus and promtool: apt install prometheus",
)


def promtool(*arguments: str, stdin: str = "") -> None:
    """Run it; a complaint fails the test."""
    ran = subprocess.run(
        ["promtool", *arguments], input=stdin, capture_output=True, text=True, check=False
    )
    assert (ran.returncode, ran.stderr) == (0, ""), ran.stdout + ran.stderr


def queries() -> list[str]:
    """Every query of the dashboard, for one robot."""
    return [
        target["expr"].replace("$robot", "yahboomd").replace("$__rate_interval", "10s")
        for panel in DASHBOARD["panels"]
        for target in panel.get("targets", [])
    ]


class Prometheus:
    """A server with its own folder, which scrapes one target every second."""

    def __init__(self, folder: Path, target: str) -> None:
        address = free_endpoint().removeprefix("tcp/")
        (folder / "alerts.yml").write_text(RULES.read_text())
        (folder / "prometheus.yml").write_text(
            (EXAMPLES / "prometheus/prometheus.yml").read_text()
            .replace("127.0.0.1:9448", target).replace("_interval: 5s", "_interval: 1s")
        )  # fmt: skip
        self.url = f"http://{address}/api/v1"
        with (folder / "log").open("w") as log:
            self.process = subprocess.Popen(
                [
                    *("prometheus", f"--config.file={folder / 'prometheus.yml'}"),
                    *(f"--storage.tsdb.path={folder / 'data'}", f"--web.listen-address={address}"),
                ],
                stdout=log,
                stderr=log,
            )

    def get(self, path: str, **parameters: str) -> Any:
        url = f"{self.url}/{path}?{urllib.parse.urlencode(parameters)}"
        with urllib.request.urlopen(url, timeout=60) as answer:
            return json.load(answer)["data"]

    def value(self, query: str) -> float | None:
        try:
            found = self.get("query", query=query)["result"]
        except OSError:
            return None
        return float(found[0]["value"][1]) if found else None

    def alerts(self) -> dict[str, str]:
        """Alerts that are pending or firing."""
        alerts = self.get("alerts")["alerts"]
        return {alert["labels"]["alertname"]: alert["state"] for alert in alerts}

    def end(self) -> None:
        self.process.terminate()
        self.process.wait()


@pytest.fixture
def prometheus(tmp_path: Path) -> Iterator[Callable[[Exporter], Prometheus]]:
    servers: list[Prometheus] = []

    def start(page: Exporter) -> Prometheus:
        target = page.url.removeprefix("http://").removesuffix("/metrics")
        servers.append(Prometheus(tmp_path, target))
        return servers[-1]

    yield start
    for server in servers:
        server.end()


@needs_prometheus
@pytest.mark.realtime
def test_prometheus_stores_a_drive_and_no_alert_is_a_false_one(
    real_robot: Callable[..., RealRobot],
    client: Callable[..., Client],
    exporter: Callable[..., Exporter],
    prometheus: Callable[[Exporter], Prometheus],
) -> None:
    robot = real_robot()
    page = exporter("--connect", robot.endpoint)
    server = prometheus(page)
    application = client("client", robot.endpoint)
    application.in_state("standing")
    application.drive_until(
        b'{"vx": 0.2}',
        lambda: (
            server.value('yahboomd_state{state="driving"}') == 1
            and (server.value("yahboomd_wheel_speed_meters_per_second") or 0) > 0.15
        ),
        "Prometheus sees the robot drive",
    )
    # Its own parser took the page without a complaint, with type, help and unit.
    # (A scrape of a busy machine may take too long.)
    (target,) = wait_for(
        lambda: [each for each in server.get("targets")["activeTargets"] if each["health"] == "up"],
        "a scrape that is well",
    )
    assert target["lastError"] == ""
    known = {each["metric"]: each for each in server.get("targets/metadata")}
    volts = {"type": "gauge", "unit": "volts", "help": "the latest voltage of the motors' supply"}
    assert volts.items() <= known["yahboomd_board_volts"].items()
    assert known["yahboomd_link_readings"]["type"] == "counter"
    # It stores the daemon's counts.
    before = application.ask("yahboomd/status")["link"]["readings"]
    stored = wait_for(
        lambda: (found := server.value("yahboomd_link_readings_total") or 0) >= before and found,
        "the newest readings are stored",
    )
    assert stored <= application.ask("yahboomd/status")["link"]["readings"]
    # Every panel can be asked for.
    for query in queries():
        server.get("query", query=query)
    promtool("check", "metrics", stdin=page.classic_page())
    # The daemon came after its exporter, so one may still be pending; it has to go.
    wait_for(lambda: not server.alerts(), "no alert is left")
    robot.daemon.end()
    wait_for(lambda: server.value("yahboomd_up") == 0, "Prometheus sees the daemon gone")
    assert server.value("yahboomd_link_readings_total") is None
    # The last status of a daemon that ends has no board.
    wait_for(lambda: server.alerts() == {"YahboomdAway": "pending"}, "the alert is on its way")


@needs_prometheus
def test_the_rules_and_the_configuration_are_what_prometheus_reads() -> None:
    promtool("check", "config", str(EXAMPLES / "prometheus/prometheus.yml"))


SERIES = {
    "YahboomdMetricsAway": ('up{job="yahboomd", instance="a"}', "0x20"),
    "YahboomdAway": ('yahboomd_up{robot="a"}', "0x20"),
    "YahboomdFault": ('yahboomd_state{robot="a", state="fault"}', "1x20"),
    "YahboomdNoBoard": ('yahboomd_state{robot="a", state="waiting"}', "1x20"),
    "YahboomdTwoDaemons": ('yahboomd_events_total{robot="a", kind="second_daemon"}', "0x3 1x17"),
    "YahboomdBatteryLow": ('yahboomd_board_volts{robot="a"}', "6.4x20"),
    "YahboomdCommandsTooOld": (
        'yahboomd_source_refused_total{robot="a", source="cmd_vel", reason="stale"}',
        "0+300x20",
    ),
    "YahboomdStarved": ('yahboomd_command_pauses_total{robot="a"}', "0+1x20"),
}
CALM = [
    ('up{job="yahboomd", instance="a"}', "1x2 0 1x17"),
    # A restart of the daemon, a fault that is released at once.
    ('yahboomd_up{robot="a"}', "1x40 0 1x40"),
    ('yahboomd_state{robot="a", state="fault"}', "0x40"),
    # The motors start, and the supply sags each time.
    ('yahboomd_board_volts{robot="a"}', "7.2 6.1 7.2 6.0 6.1 7.1 6.0 7.2 6.1 7.2 6.1 7.2"),
    # The board is unplugged and in again; without a battery it has no voltage.
    ('yahboomd_state{robot="a", state="waiting"}', "0x20 1x1 0x20"),
    ('yahboomd_board_volts{robot="b"}', "0.2x40"),
    # Another source has control, an e-stop is engaged: refused for ever.
    (
        'yahboomd_source_refused_total{robot="a", source="cmd_vel", reason="lower_priority"}',
        "0+600x40",
    ),
    ('yahboomd_command_pauses_total{robot="a"}', "0x10 1x20"),
    ('yahboomd_events_total{robot="a", kind="second_daemon"}', "0x40"),
    ('yahboomd_link_bytes_total{robot="a"}', "0+100000x40"),
    ('yahboomd_link_discarded_bytes_total{robot="a"}', "0+500x40"),
]


def rule_test(series: list[tuple[str, str]], alerts: dict[str, list[str]]) -> str:
    """A file for `promtool test rules`: these series, a value each 30 s, and who is to sound."""
    return json.dumps(
        {
            "rule_files": [str(RULES)],
            "evaluation_interval": "10s",
            "tests": [
                {
                    "interval": "30s",
                    "input_series": [{"series": name, "values": each} for name, each in series],
                    "promql_expr_test": [
                        {
                            "expr": f'count(ALERTS{{alertname="{name}",alertstate="firing"}})',
                            "eval_time": moment,
                            "exp_samples": [{"labels": "{}", "value": 1}] if sounds else [],
                        }
                        for moment, sounding in alerts.items()
                        for name in [*SERIES, "YahboomdLineNoisy"]
                        for sounds in [name in sounding]
                    ],
                }
            ],
        }
    )


@needs_prometheus
@pytest.mark.parametrize("alert", SERIES)
def test_an_alert_sounds_for_its_trouble_and_no_other(tmp_path: Path, alert: str) -> None:
    (tmp_path / "test.yml").write_text(rule_test([SERIES[alert]], {"8m": [alert]}))
    promtool("test", "rules", str(tmp_path / "test.yml"))


@needs_prometheus
def test_a_line_that_garbles_sounds(tmp_path: Path) -> None:
    line = [
        ('yahboomd_link_bytes_total{robot="a"}', "0+10000x40"),
        ('yahboomd_link_discarded_bytes_total{robot="a"}', "0+500x40"),
    ]
    (tmp_path / "test.yml").write_text(rule_test(line, {"12m": ["YahboomdLineNoisy"]}))
    promtool("test", "rules", str(tmp_path / "test.yml"))


@needs_prometheus
def test_what_is_usual_on_a_robot_sounds_no_alarm(tmp_path: Path) -> None:
    moments = {f"{minutes}m": [] for minutes in range(1, 20)}
    (tmp_path / "test.yml").write_text(rule_test(CALM, moments))
    promtool("test", "rules", str(tmp_path / "test.yml"))


NAME = re.compile(r"\byahboomd_[a-z0-9_]*[a-z0-9]\b")


def known_names() -> set[str]:
    source = (EXAMPLES.parent / "yahboomd/tools/metrics/robot_metrics.py").read_text()
    made = re.findall(r'(?:_gauge|_set|\s)\(\s*(?:"(?:counter|info)", )?"(\w+)"', source)
    fixed = set(NAME.findall(source)) | {f"{PREFIX}{name}" for name in made}
    of_fields = {metric_name(field) for field in FIELDS if field.kind != "text"}
    names = fixed | of_fields
    return names | {f"{name}_total" for name in names} | {f"{name}_info" for name in names}


@pytest.mark.parametrize(
    "path", ["examples/grafana/yahboomd.json", "examples/prometheus/alerts.yml", "docs/metrics.md"]
)
def test_every_metric_that_is_named_exists(path: str) -> None:
    named = set(NAME.findall((EXAMPLES.parent / path).read_text()))
    assert len(named) > 5
    assert named - known_names() == set()


def test_every_panel_has_a_title_a_place_and_the_chosen_source_of_data() -> None:
    places: set[tuple[int, int]] = set()
    for panel in DASHBOARD["panels"]:
        assert panel["title"]
        place = panel["gridPos"]
        cells = {
            (x, y)
            for x in range(place["x"], place["x"] + place["w"])
            for y in range(place["y"], place["y"] + place["h"])
        }
        assert not cells & places, panel["title"]
        assert place["x"] + place["w"] <= 24
        places |= cells
        for target in panel.get("targets", []):
            assert target["datasource"]["uid"] == "${datasource}"
