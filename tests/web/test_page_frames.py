"""The frames that a page may send."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.web.page_session import Control, Drive, RequestFrame, StopFrame, read_frame


def test_every_frame_of_a_page_is_read() -> None:
    assert read_frame('{"type":"drive","beat":7,"vx":0.5,"vy":0,"wz":-1}') == Drive(7, 0.5, 0, -1)
    assert read_frame('{"type":"control","want":true}') == Control(want=True)
    assert read_frame('{"type":"estop"}') == StopFrame()
    assert read_frame('{"type":"request","id":3,"do":"release"}') == RequestFrame(3, "release")


@pytest.mark.parametrize(
    "text",
    [
        *("", "null", "[]", "{}", '{"type":"drive"}', "[" * 2000, '{"type":"beat","beat":1}'),
        '{"type":"drive","beat":-1,"vx":0,"vy":0,"wz":0}',
        '{"type":"drive","beat":1.5,"vx":0,"vy":0,"wz":0}',
        '{"type":"drive","beat":1,"vx":"1","vy":0,"wz":0}',
        '{"type":"drive","beat":1,"vx":NaN,"vy":0,"wz":0}',
        '{"type":"drive","beat":1,"vx":1e999,"vy":0,"wz":0}',
        '{"type":"drive","beat":1,"vx":true,"vy":0,"wz":0}',
        '{"type":"control","want":1}',
    ],
)
def test_what_no_page_sends_is_no_frame(text: str) -> None:
    assert read_frame(text) is None


@given(st.text() | st.recursive(st.none() | st.floats() | st.text(), st.lists).map(json.dumps))
def test_nothing_that_comes_raises(text: str) -> None:
    read_frame(text)
