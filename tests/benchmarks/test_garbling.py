from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from benchmarks.garbling import altered, garble
from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.robot import SimulatedRobot

MS = 1_000_000


@given(st.lists(st.integers(-(2**31), 2**31 - 1), min_size=4, max_size=4))
def test_an_altered_answer_is_a_frame_of_the_same_length_with_another_first_count(counts) -> None:
    answer = b"$data:%d,%d,%d,%d#" % tuple(counts)
    wrong = altered(answer)
    assert len(wrong) == len(answer)
    first, *others = wrong.removeprefix(b"$data:").removesuffix(b"#").split(b",")
    assert int(first) != counts[0]
    assert [int(each) for each in others] == counts[1:]


def test_one_answer_alone_is_garbled() -> None:
    robot = SimulatedRobot(SimulationOptions(dialect="polled", initial_ticks=(5234, 0, 70, 0)))
    robot.start(0)
    answers = []
    for n in range(3):
        if n == 1:
            garble(robot, [], 0)
        robot.host_wrote(b"$read#", n * 50 * MS)
        answers.append(b"".join(robot.host_reads((n * 50 + 40) * MS)))
    assert answers == [b"$data:5234,0,70,0#", b"$data:4234,0,70,0#", b"$data:5234,0,70,0#"]
