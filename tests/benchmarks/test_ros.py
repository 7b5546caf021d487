from __future__ import annotations

import json

import pytest

from benchmarks import ros_ways
from benchmarks.results import NotHere
from benchmarks.ros import M_PER_COUNT, command_times, recorded, sample_times

MS = 1_000_000


def test_a_command_ends_at_its_own_frame_and_one_without_a_frame_is_left_out() -> None:
    sent = [(10 * MS, 0.3004), (20 * MS, 0.3014), (30 * MS, 0.3024)]
    written = [(9 * MS, 300, 300), (12 * MS, 300, 300), (35 * MS, 302, 302)]
    assert command_times(sent, written) == [2 * MS, 5 * MS]


def test_a_frame_of_a_second_later_belongs_to_another_command() -> None:
    assert command_times([(0, 0.3004)], [(1000 * MS, 300, 300)]) == []


def test_a_sample_is_the_answer_whose_counts_the_pose_is_made_of(tmp_path) -> None:
    file = tmp_path / "answers"
    texts = [(5 * MS, "$data:10,0,12,0#"), (25 * MS, "$data:30,0,31,0#")]
    file.write_text("".join(json.dumps(each) + "\n" for each in texts))
    answers = recorded(file)
    assert answers == [(5 * MS, 22), (25 * MS, 61)]
    arrivals = [(9 * MS, 11 * M_PER_COUNT), (26 * MS, 30.5 * M_PER_COUNT), (28 * MS, 1.0)]
    assert sample_times(answers, arrivals) == [4 * MS, 1 * MS]


def test_where_ros_is_not_built_the_reason_says_what_builds_it(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(ros_ways, "CACHE", tmp_path)
    with pytest.raises(NotHere, match="`make interop` builds it"):
        ros_ways.ways()


@pytest.mark.parametrize(("named", "count"), [("", 2), ("/usr/bin/python3", 3)])
def test_natively_is_measured_where_an_interpreter_is_named(
    tmp_path, monkeypatch, named, count
) -> None:
    for path in ("ros-jazzy/bin/python", "bin/current/bridge"):
        (tmp_path / path).parent.mkdir(parents=True)
        (tmp_path / path).touch()
    monkeypatch.setattr(ros_ways, "CACHE", tmp_path)
    monkeypatch.setenv("YAHBOOMD_RMW_ZENOH_PYTHON", named)
    assert len(ros_ways.ways()) == count
