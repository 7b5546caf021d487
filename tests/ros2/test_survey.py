"""A question that is asked again and again: answers of one round at a time, within bounds."""

import pytest
from zenoh_fixtures import eventually

from yahboomd.ros2.survey import LONGEST_REPLY, MOST_REPLIES, Survey

pytestmark = pytest.mark.realtime


def answering(app, key, *answers):
    """Answers with one payload for each key below it."""

    def answer(query):
        for number, payload in enumerate(answers):
            query.reply(f"{key}/{number}", payload)

    return app.session.declare_queryable(f"{key}/**", answer)


async def asked_until(survey, rounds, wanted):
    """Ask until a round is as wanted: a session that has just come is not found at once."""

    def found():
        survey.ask()
        return rounds and sorted(rounds[-1]) == sorted(wanted)

    await eventually(found)


async def test_every_answer_of_the_latest_round_comes_together(bus, zenoh_app):
    rounds = []
    survey = Survey(bus, "/@/*/ros2/**", rounds.append)
    await asked_until(survey, rounds, [])
    one, other = (zenoh_app("client", bus.options.listen[0]) for _ in range(2))
    first = answering(one, "@/aa/ros2", b"a", b"b")
    second = answering(other, "@/bb/ros2", b"c")
    await asked_until(survey, rounds, [b"a", b"b", b"c"])
    first.undeclare()
    await asked_until(survey, rounds, [b"c"])
    second.undeclare()
    await asked_until(survey, rounds, [])


async def test_what_answers_may_hold_is_bounded(bus, zenoh_app):
    rounds = []
    survey = Survey(bus, "/@/*/ros2/**", rounds.append)
    app = zenoh_app("client", bus.options.listen[0])
    many = [b"%d" % number for number in range(MOST_REPLIES + 10)]
    _queryable = answering(app, "@/aa/ros2", bytes(LONGEST_REPLY + 1), *many)

    def found():
        survey.ask()
        # A round that was over before all had answered has fewer.
        return rounds and len(rounds[-1]) >= MOST_REPLIES and rounds[-1]

    kept = await eventually(found)
    assert len(kept) == MOST_REPLIES
    assert set(kept) <= set(many)
