from __future__ import annotations

import pytest

from yahboomd.core.errors import ConfigError
from yahboomd.core.protocol.settings import StoredSetting, check_storable, is_complete, writes


def row(field, **more):
    usual = {"least": 1, "most": 9, "limits": "1 to 9", "wire": str, "timeout_s": 0.1}
    return StoredSetting(
        field=field,
        command=field.upper(),
        label=f"the {field}",
        frame=lambda text: f"{field}={text}".encode(),
        **(usual | more),
    )


TABLE = (row("wide"), row("gains", parts=("p", "i")), row("long", unit=" mm", resets=True))


def test_only_what_differs_is_written_in_the_order_of_the_table():
    have = {"long": 2, "wide": 3, "gains": (1, 2)}
    found = writes(TABLE, have, {"long": 4, "gains": (1, 2), "wide": 5, "strange": 6})
    assert [(each.frame, each.text) for each in found] == [
        (b"wide=5", "the wide 5"),
        (b"long=4", "the long 4 mm"),
    ]
    assert [(each.reply_to, each.resets) for each in found] == [("WIDE", False), ("LONG", True)]


def test_what_is_not_shown_or_not_wanted_is_left_alone():
    assert writes(TABLE, {"wide": 1}, {"long": 2}) == ()


def test_what_follows_one_that_is_left_alone_is_written():
    (found,) = writes(TABLE, {"long": 2}, {"wide": 1, "long": 3})
    assert found.frame == b"long=3"


def test_every_value_that_must_not_be_stored_is_named():
    check_storable(TABLE, {"wide": 9, "gains": (1, 9), "long": 1})
    with pytest.raises(ConfigError) as refused:
        check_storable(TABLE, {"wide": 10, "gains": (1, 0), "long": float("nan")})
    words = "the wide 10 (1 to 9), the gains (1, 0) (1 to 9), the long nan mm (1 to 9)"
    assert words in str(refused.value)


def test_settings_are_complete_with_every_row_and_the_version():
    whole = {"wide": 1, "gains": (1, 2), "long": 3, "version": "1"}
    assert is_complete(TABLE, whole)
    for field in whole:
        assert not is_complete(TABLE, {each: whole[each] for each in whole if each != field})


def test_numbers_of_one_value_have_names_of_their_own_among_the_facts():
    wide, gains, _ = TABLE
    assert wide.named(3) == {"wide": 3}
    assert wide.named(None) == {"wide": None}
    assert gains.named((1, 2)) == {"p": 1, "i": 2}
    assert gains.named(None) == {}
