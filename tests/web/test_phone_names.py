"""Names of phones."""

from __future__ import annotations

import pytest

from yahboomd.web.phone_sessions import LONGEST, clean_name, device, free_name, is_taken


@pytest.mark.parametrize(
    ("header", "kind"),
    [
        ("Mozilla/5.0 (iPhone; CPU iPhone OS 17_0 like Mac OS X) AppleWebKit/605.1.15", "iPhone"),
        ("Mozilla/5.0 (Linux; Android 14; Pixel 8) AppleWebKit/537.36 Chrome", "Android phone"),
        (
            "Mozilla/5.0 (X11; Linux x86_64) AppleWebKit/537.36 (KHTML, like Gecko)",
            "Linux computer",
        ),
        ("Mozilla/5.0 (Macintosh; Intel Mac OS X 10_15_7)", "Mac"),
        ("", "A browser"),
        ("\x1b[31m", "A browser"),
    ],
)
def test_a_phone_without_a_name_is_called_by_its_kind(header: str, kind: str) -> None:
    assert device(header) == kind


def test_a_name_keeps_letters_of_every_script_and_loses_all_that_commands_a_terminal() -> None:
    assert clean_name("  J\u00fcrgen\u2019s   phone ") == "J\u00fcrgen\u2019s phone"
    assert clean_name("\u5f20\u4f1f") == "\u5f20\u4f1f"
    assert clean_name("a\x1b[31m\u202eb\nc\u200b") == "a [31m b c"
    assert clean_name("\n\t\u200b") == ""
    assert len(clean_name("x" * 10_000)) == LONGEST


@pytest.mark.parametrize("unseen", ["\ufe0f", "\u034f", "\u3164", "\u2800", "\uffa0", "\U000e0100"])
def test_a_name_has_no_letters_and_marks_that_show_nothing(unseen: str) -> None:
    assert clean_name(f"An{unseen}na{unseen}") == "Anna"
    assert clean_name(unseen) == ""


def test_names_that_people_would_confuse_are_taken() -> None:
    assert is_taken("anna", ["Anna"])
    assert is_taken("\uff21nna", ["Anna"])
    assert is_taken("This page", [])
    assert not is_taken("Bert", ["Anna"])
    assert free_name("Mac", ["Mac", "Mac 2"]) == "Mac 3"
    assert free_name("Mac", []) == "Mac"
