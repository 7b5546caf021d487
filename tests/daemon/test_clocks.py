"""A clock that is off is told once."""

from __future__ import annotations

from yahboomd.daemon.clocks import ClockWatch
from yahboomd.model import Event

S = 1_000_000_000


class Scene:
    """Warnings as they are set, and what was told of them."""

    def __init__(self) -> None:
        self.warnings: dict[str, str] = {}
        self.told: list[Event] = []
        self._watch = ClockWatch(lambda _now_ns: self.warnings, self.told.append)

    def look(self, at_s: int, **warnings: str) -> None:
        self.warnings = warnings
        self._watch.look(at_s * S)


def test_a_clock_that_is_off_is_told_once_while_it_is() -> None:
    scene = Scene()
    for second in range(600):
        scene.look(second, cmd_vel=f"Its clock is {second} s behind.")
    (event,) = scene.told
    assert (event.kind, event.severity) == ("clock_offset", "warning")
    assert event.message == "cmd_vel: Its clock is 0 s behind."
    assert event.data == {"source": "cmd_vel"}


def test_it_is_news_again_after_it_was_right_for_a_minute() -> None:
    scene = Scene()
    scene.look(0, cmd_vel="off")
    scene.look(30)
    scene.look(50, cmd_vel="off")
    assert len(scene.told) == 1
    scene.look(120, cmd_vel="off")
    assert len(scene.told) == 2


def test_each_source_has_a_clock_of_its_own() -> None:
    scene = Scene()
    scene.look(0, cmd_vel="off")
    scene.look(1, cmd_vel="off", joystick="off")
    assert [event.message for event in scene.told] == ["cmd_vel: off", "joystick: off"]
