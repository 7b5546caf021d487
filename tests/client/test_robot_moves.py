"""The moves by name become what is asked for."""

from __future__ import annotations

import math
from typing import Any

import pytest

from yahboomd.client.move_messages import Move
from yahboomd.client.robot_moves import RobotMoves


class Asked(Exception):
    """Carries the moves that were asked for."""


class Recorder(RobotMoves):
    def moves(self, *moves: Move, uncertain_m: float | None = None) -> Any:
        raise Asked(*moves)


async def asked(name: str, *arguments: Any, **options: Any) -> Move:
    with pytest.raises(Asked) as caught:
        await getattr(Recorder(), name)(*arguments, **options)
    (move,) = caught.value.args
    return move


async def test_each_method_asks_for_its_move() -> None:
    assert await asked("straight", -1) == Move(kind="straight", distance_m=-1.0)
    assert await asked("straight", 0.0, left_m=0.5) == Move(kind="straight", left_m=0.5)
    assert await asked("turn", 1.5) == Move(kind="turn", angle_rad=1.5)
    assert await asked("turn", degrees=90) == Move(kind="turn", angle_rad=math.pi / 2.0)
    assert await asked("arc", 0.5, degrees=-180, backward=True) == Move(
        kind="arc", radius_m=0.5, angle_rad=-math.pi, backward=True
    )
    assert await asked("go_to", 2, 1) == Move(kind="go_to", x=2.0, y=1.0)
    assert await asked("go_to", 2, 1, 0.0, backward=True) == Move(
        kind="go_to", x=2.0, y=1.0, theta=0.0, backward=True
    )
    assert await asked("follow", [[1, 2], (3, 4, 0.5)], corner_m=0.1) == Move(
        kind="follow", points=((1.0, 2.0), (3.0, 4.0, 0.5)), corner_m=0.1
    )


@pytest.mark.parametrize(
    ("name", "arguments", "options"),
    [
        ("turn", (), {}),
        ("turn", (1.0,), {"degrees": 90}),
        ("turn", (True,), {}),
        ("straight", ("1",), {}),
        ("straight", (1.0,), {"fast": 1.0}),
        ("go_to", (1.0, None), {}),
    ],
)
async def test_what_is_no_number_or_no_limit_is_a_type_error(
    name: str, arguments: tuple[Any, ...], options: dict[str, Any]
) -> None:
    with pytest.raises(TypeError):
        await getattr(Recorder(), name)(*arguments, **options)


async def test_a_point_has_two_or_three_numbers() -> None:
    with pytest.raises(ValueError, match="A point is"):
        await Recorder().follow([(1.0,)])
