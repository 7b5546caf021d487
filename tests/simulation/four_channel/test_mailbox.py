from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.simulation.four_channel.mailbox import LONGEST_FRAME, Mailbox


def feed(mailbox: Mailbox, data: bytes) -> None:
    for byte in data:
        mailbox.put(byte)


def test_a_frame_is_what_stands_between_dollar_and_hash() -> None:
    mailbox = Mailbox()
    feed(mailbox, b"noise\r\n$read_vol#\r\n")
    assert mailbox.ready
    assert mailbox.take() == b"read_vol"
    assert not mailbox.ready


def test_a_dollar_inside_a_frame_is_data_so_half_a_frame_swallows_the_next() -> None:
    mailbox = Mailbox()
    feed(mailbox, b"$spd:1,2$pwm:0,0,0,0#")
    assert mailbox.take() == b"spd:1,2$pwm:0,0,0,0"


def test_a_lone_hash_executes_the_fragment() -> None:
    mailbox = Mailbox()
    feed(mailbox, b"$spd:100,100")
    assert not mailbox.ready
    feed(mailbox, b"#")
    assert mailbox.take() == b"spd:100,100"


def test_a_hash_without_a_frame_is_nothing() -> None:
    mailbox = Mailbox()
    feed(mailbox, b"##")
    assert not mailbox.ready


def test_51_characters_fit_and_52_are_too_long() -> None:
    mailbox = Mailbox()
    feed(mailbox, b"$" + b"x" * LONGEST_FRAME + b"#")
    assert mailbox.ready
    assert not mailbox.too_long
    mailbox.reset()
    feed(mailbox, b"$" + b"x" * (LONGEST_FRAME + 1) + b"#")
    assert mailbox.too_long
    assert not mailbox.ready


@given(st.binary(max_size=200).map(lambda noise: noise.replace(b"#", b"")))
def test_64_newlines_free_the_way_after_any_half_frame(noise: bytes) -> None:
    mailbox = Mailbox()
    feed(mailbox, noise + b"\n" * 64 + b"$pwm:0,0,0,0#")
    assert mailbox.ready
    assert mailbox.take() == b"pwm:0,0,0,0"


def test_52_newlines_are_the_fewest_that_do() -> None:
    for newlines, found in ((51, False), (52, True)):
        mailbox = Mailbox()
        feed(mailbox, b"$" + b"\n" * newlines + b"$stop#")
        assert (mailbox.take() == b"stop") is found


def test_the_newest_of_two_waiting_frames_wins() -> None:
    mailbox = Mailbox()
    feed(mailbox, b"$first#$second#")
    assert mailbox.take() == b"second"


@pytest.mark.parametrize("ends_long", [False, True])
def test_of_a_frame_and_one_that_is_too_long_the_later_one_counts(ends_long: bool) -> None:
    mailbox = Mailbox()
    frames = [b"$first#", b"$" + b"x" * (LONGEST_FRAME + 1)]
    for frame in frames if ends_long else reversed(frames):
        feed(mailbox, frame)
    assert (mailbox.ready, mailbox.too_long) == (not ends_long, ends_long)


def test_a_frame_that_ends_before_the_wipe_is_found_empty() -> None:
    mailbox = Mailbox()
    feed(mailbox, b"$first#")
    mailbox.take()
    feed(mailbox, b"$second#")
    mailbox.wipe()
    assert mailbox.ready
    assert mailbox.take() == b""


def test_a_frame_that_only_begins_before_the_wipe_survives_it() -> None:
    mailbox = Mailbox()
    feed(mailbox, b"$first#")
    mailbox.take()
    feed(mailbox, b"$sec")
    mailbox.wipe()
    feed(mailbox, b"ond#")
    assert mailbox.take() == b"second"


def test_a_spoilt_frame_is_no_command_any_more() -> None:
    mailbox = Mailbox()
    feed(mailbox, b"$spd:1,1,1,1#")
    mailbox.spoil()
    assert not mailbox.take().startswith(b"spd")
