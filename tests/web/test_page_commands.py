"""Which commands of pages become samples on the bus."""

from __future__ import annotations

import asyncio

import pytest

from yahboomd.core.model import STANDSTILL, Twist2d
from yahboomd.simulation.virtual_time import LoopClock, VirtualTimeLoop, on_virtual_time
from yahboomd.web.page_commands import PageCommands, PageRefusal, Wanted
from yahboomd.web.page_session import Go

FORWARD = Twist2d(vx=0.3)
PLACE = Go(beat=1, x=1.0, y=2.0, turn=False, speed_m_s=0.3, turn_rad_s=1.5)
FRESH_NS = 40_000_000
LATE_NS = 300_000_001

ANNE, BERT = 1, 2

ESTOP = PageRefusal(why="estop", text="The emergency stop is engaged.")


HELD = pytest.mark.parametrize(
    "held", [pytest.param(FORWARD, id="joystick"), pytest.param(PLACE, id="map")]
)
"""What is held on the map ends as what is held on the joystick does."""


class Scene:
    """Commands of two pages, and what reaches the bus, with its time in milliseconds.

    Args:
        driver: The page that has control.
    """

    def __init__(self, driver: int | None = ANNE) -> None:
        self.put: list[tuple[int, Wanted]] = []
        self.obstacle: PageRefusal | None = None
        self.changes = 0
        self.lapsed: list[int] = []
        self.kept = False
        self.clock = LoopClock()
        self.begun_ns = self.clock.now_ns()
        self.commands = PageCommands(
            self.clock,
            lambda twist: self.put.append((self.ms, twist)),
            obstacle=lambda _: self.obstacle,
            changed=self._changed,
            lapsed=lambda page, _refusal: self.lapsed.append(page),
            kept=lambda: self.kept,
        )
        if driver is not None:
            self.commands.take_control(driver)

    @property
    def ms(self) -> int:
        return round((self.clock.now_ns() - self.begun_ns) / 1e6)

    @property
    def twists(self) -> list[Wanted]:
        return [twist for _, twist in self.put]

    def _changed(self) -> None:
        self.changes += 1

    def why(self, page: int, twist: Wanted = FORWARD, age_ns: int | None = FRESH_NS) -> str:
        """The reason of a refusal; empty if the command is obeyed."""
        refusal = self.commands.command(page, twist, age_ns)
        return "" if refusal is None else refusal.why


@on_virtual_time
async def test_a_command_becomes_one_sample_and_nothing_is_repeated() -> None:
    scene = Scene()
    for _ in range(3):
        assert scene.why(ANNE) == ""
        await asyncio.sleep(0.05)
    assert scene.twists == [FORWARD] * 3
    assert scene.commands.driver == ANNE


@HELD
@on_virtual_time
async def test_a_command_with_an_old_beat_is_refused_and_stops_the_page_that_drove(
    held: Wanted,
) -> None:
    scene = Scene()
    assert scene.why(ANNE, held, age_ns=300_000_000) == ""
    assert scene.why(ANNE, held, age_ns=LATE_NS) == "late"
    assert scene.twists == [held, STANDSTILL]


@on_virtual_time
async def test_an_unknown_beat_moves_nothing() -> None:
    scene = Scene()
    assert scene.why(ANNE, age_ns=None) == "late"
    assert scene.twists == []


@on_virtual_time
async def test_without_asking_for_control_no_page_drives() -> None:
    scene = Scene(driver=None)
    assert scene.why(ANNE) == "not_yours"
    assert scene.twists == []
    scene.commands.take_control(ANNE)
    # Its thumb was down before.
    assert scene.why(ANNE) == "let_go"
    scene.why(ANNE, STANDSTILL)
    assert scene.why(ANNE) == ""


@HELD
@on_virtual_time
async def test_after_a_refusal_the_page_has_to_let_go_before_it_moves_again(held: Wanted) -> None:
    scene = Scene()
    scene.obstacle = ESTOP
    assert scene.why(ANNE, held) == "estop"
    scene.obstacle = None
    assert scene.why(ANNE, held) == "let_go"
    assert scene.why(ANNE, held) == "let_go"
    assert scene.twists == []
    assert scene.why(ANNE, STANDSTILL) == ""
    assert scene.why(ANNE, held) == ""
    assert scene.twists == [held]


@HELD
@on_virtual_time
async def test_a_page_that_falls_silent_in_motion_is_stopped_with_zeros_for_a_second(
    held: Wanted,
) -> None:
    scene = Scene()
    scene.why(ANNE, held)
    await asyncio.sleep(5)
    assert scene.put[:2] == [(0, held), (300, STANDSTILL)]
    assert set(scene.twists[1:]) == {STANDSTILL}
    assert 1250 <= scene.put[-1][0] <= 1300
    assert scene.lapsed == [ANNE]
    assert scene.why(ANNE, held) == "let_go"


@on_virtual_time
async def test_zeros_of_a_page_are_passed_on_for_a_second_and_no_longer() -> None:
    """A zero holds control of the robot."""
    scene = Scene()
    scene.why(ANNE)
    for _ in range(100):
        scene.why(ANNE, STANDSTILL)
        await asyncio.sleep(0.05)
    assert 1000 <= scene.put[-1][0] <= 1300
    assert scene.lapsed == []


@on_virtual_time
async def test_a_zero_stops_however_old_its_beat_and_only_from_the_page_in_control() -> None:
    scene = Scene()
    scene.why(BERT, STANDSTILL)
    assert scene.twists == []
    scene.why(ANNE)
    scene.why(BERT, STANDSTILL)
    assert scene.twists == [FORWARD]
    assert scene.why(ANNE, STANDSTILL, None) == ""
    assert scene.twists == [FORWARD, STANDSTILL]


@HELD
@on_virtual_time
async def test_one_page_has_control_until_another_takes_it_and_then_the_wheels_stop_first(
    held: Wanted,
) -> None:
    scene = Scene()
    scene.why(ANNE, held)
    assert scene.why(BERT, held) == "not_yours"
    assert scene.changes == 1
    scene.commands.take_control(BERT)
    assert scene.twists == [held, STANDSTILL]
    assert (scene.commands.driver, scene.changes) == (BERT, 2)
    # Its thumb was down all the time.
    assert scene.why(BERT, held) == "let_go"
    scene.why(BERT, STANDSTILL)
    assert scene.why(BERT, held) == ""
    assert scene.why(ANNE, held) == "not_yours"
    scene.commands.take_control(BERT)
    assert scene.changes == 2


@on_virtual_time
async def test_a_new_drivers_commands_are_not_mixed_with_the_zeros_of_the_one_before() -> None:
    scene = Scene()
    scene.why(ANNE)
    scene.commands.take_control(BERT)
    await asyncio.sleep(0.1)
    begun = len(scene.put)
    for _ in range(10):
        scene.why(BERT)
        await asyncio.sleep(0.05)
    assert scene.twists[begun:] == [FORWARD] * 10


@HELD
@on_virtual_time
async def test_a_page_that_is_closed_in_motion_stops_the_wheels_at_once_and_frees_control(
    held: Wanted,
) -> None:
    scene = Scene()
    scene.why(ANNE, held)
    await asyncio.sleep(0.02)
    scene.commands.closed(BERT)
    assert scene.twists == [held]
    scene.commands.closed(ANNE)
    assert scene.put[-1] == (20, STANDSTILL)
    assert scene.commands.driver is None
    scene.commands.take_control(BERT)
    assert scene.why(BERT, held) == ""


@HELD
@on_virtual_time
async def test_the_end_of_the_server_stops_the_wheels_and_no_page_moves_them_again(
    held: Wanted,
) -> None:
    scene = Scene()
    scene.why(ANNE, held)
    scene.commands.end()
    assert scene.why(ANNE, held) == "ended"
    scene.why(ANNE, STANDSTILL)
    assert scene.why(ANNE, held) == "ended"
    assert held not in scene.twists[1:]
    assert STANDSTILL in scene.twists
    scene.commands.close()


@HELD
@on_virtual_time
async def test_frames_that_waited_while_the_server_stood_still_move_nothing(held: Wanted) -> None:
    """As after SIGSTOP and SIGCONT: the timer of the silence is late, too."""
    scene = Scene()
    scene.why(ANNE, held)
    loop = asyncio.get_running_loop()
    assert isinstance(loop, VirtualTimeLoop)
    loop.freeze(1.0)
    assert [scene.why(ANNE, held, age_ns=1_000_000_000 + FRESH_NS) for _ in range(20)] == [
        "late"
    ] * 20
    await asyncio.sleep(2)
    assert scene.twists[0] == held
    assert held not in scene.twists[1:]


@on_virtual_time
async def test_of_joystick_and_map_one_is_held_and_let_go_before_the_other_one_counts() -> None:
    for first, second in ((FORWARD, PLACE), (PLACE, FORWARD)):
        scene = Scene()
        scene.why(ANNE, first)
        assert scene.why(ANNE, second) == "let_go"
        assert scene.twists == [first, STANDSTILL]
        assert scene.why(ANNE, first) == "let_go"
        scene.why(ANNE, STANDSTILL)
        assert scene.why(ANNE, second) == ""


@HELD
@on_virtual_time
async def test_a_page_that_has_not_driven_for_a_while_lets_go_of_control(held: Wanted) -> None:
    scene = Scene()
    await asyncio.sleep(29)
    assert scene.why(ANNE, held) == ""
    scene.why(ANNE, STANDSTILL)
    await asyncio.sleep(29)
    assert scene.commands.driver == ANNE
    put = len(scene.put)
    await asyncio.sleep(2)
    assert (scene.commands.driver, scene.changes) == (None, 2)
    assert scene.why(ANNE, held) == "not_yours"
    # Nothing is sent for it: the robot stood.
    assert len(scene.put) == put
    scene.commands.take_control(BERT)
    assert scene.why(BERT, held) == ""


@on_virtual_time
async def test_a_thumb_that_rests_or_is_refused_counts_as_driving() -> None:
    scene = Scene()
    for _ in range(200):
        scene.why(ANNE, STANDSTILL)
        await asyncio.sleep(0.5)
    scene.obstacle = ESTOP
    for _ in range(200):
        scene.why(ANNE)
        await asyncio.sleep(0.5)
    assert scene.commands.driver == ANNE
    # Another page's does not.
    for _ in range(70):
        scene.why(BERT, STANDSTILL)
        await asyncio.sleep(0.5)
    assert scene.commands.driver is None


@on_virtual_time
async def test_control_is_kept_while_it_is_needed_and_lets_go_afterwards() -> None:
    scene = Scene()
    scene.kept = True
    await asyncio.sleep(100)
    assert scene.commands.driver == ANNE
    scene.kept = False
    await asyncio.sleep(31)
    assert scene.commands.driver is None
    await asyncio.sleep(100)
    assert scene.changes == 2


@HELD
@on_virtual_time
async def test_of_two_pages_that_take_control_at_once_one_has_it_and_zero_comes_first(
    held: Wanted,
) -> None:
    scene = Scene()
    # Both thumbs are down from here on.
    scene.why(ANNE, held)
    scene.why(BERT, held)
    for page in (BERT, ANNE, BERT):
        scene.commands.take_control(page)
        assert scene.why(ANNE, held) in {"not_yours", "let_go"}
        assert scene.why(BERT, held) in {"not_yours", "let_go"}
    assert scene.commands.driver == BERT
    assert scene.twists[:2] == [held, STANDSTILL]
    await asyncio.sleep(2)
    assert set(scene.twists[1:]) == {STANDSTILL}
    scene.why(BERT, STANDSTILL)
    assert scene.why(BERT, held) == ""
