"""`yahboomd pose` of a real daemon."""

from __future__ import annotations

import json
from collections.abc import Callable

import daemon_samples
import pytest
from real_robot import wait_for

from yahboomd.cli.pose import line

pytestmark = [pytest.mark.realtime, pytest.mark.xdist_group("one_robot")]


@pytest.fixture
def printed(on_robot: Callable[..., int], capsys) -> Callable[[], str]:
    def pose() -> str:
        capsys.readouterr()
        on_robot("pose")
        return capsys.readouterr().out

    return pose


def test_the_pose_is_set_printed_and_reset(
    on_robot: Callable[..., int], printed: Callable[[], str]
) -> None:
    assert on_robot("pose", "--to", "1.25", "-8.6e-17", "-0.5") == 0
    wait_for(lambda: printed() == "1.250000 0.000000 -0.500000\n", "the pose that was set")
    assert on_robot("pose", "--reset") == 0
    wait_for(lambda: printed() == "0.000000 0.000000 0.000000\n", "the pose is zero")


def test_json_is_the_sample_in_one_line(on_robot: Callable[..., int], capsys) -> None:
    def printed() -> bool:
        capsys.readouterr()
        # It is old if a busy machine holds the board up.
        return on_robot("pose", "--json") == 0

    wait_for(printed, "a pose that is not old")
    said = capsys.readouterr().out
    assert said.count("\n") == 1
    assert {"x", "y", "theta", "covariance", "stamp_ns"} <= set(json.loads(said))


def test_a_heading_is_in_degrees_only_where_it_says_so(
    on_robot: Callable[..., int], printed: Callable[[], str], capsys
) -> None:
    assert on_robot("pose", "--to", "1", "2", "-90deg") == 0
    wait_for(lambda: printed() == "1.000000 2.000000 -1.570796\n", "the pose in degrees")
    assert on_robot("pose", "--to", "0", "0", "90") == 2
    assert "90 is 14.3 turns. For degrees write 90deg." in capsys.readouterr().err
    assert printed() == "1.000000 2.000000 -1.570796\n"


@pytest.mark.parametrize("given", [["1", "2", "nan"], ["1", "2", "north"], ["1deg", "2", "0"]])
def test_what_is_no_pose_is_a_mistake(on_robot: Callable[..., int], given: list[str]) -> None:
    assert on_robot("pose", "--to", *given) == 2


def test_numbers_have_six_digits_and_no_negative_zero() -> None:
    assert line(daemon_samples.pose(1e-9, -1e-9, -2.5)) == "0.000000 0.000000 -2.500000"
