"""Tokens, and the cookies that they become."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from yahboomd.core.errors import ConfigError
from yahboomd.web.entry_tokens import FILE, Tokens, make_tokens, read_tokens


def test_tokens_are_made_once_for_this_user_alone(tmp_path: Path) -> None:
    folder = tmp_path / "state"
    assert read_tokens(folder) is None
    made = make_tokens(folder)
    assert read_tokens(folder) == made
    assert (folder / FILE).stat().st_mode & 0o777 == 0o600
    assert folder.stat().st_mode & 0o777 == 0o700
    assert [each.name for each in folder.iterdir()] == [FILE]
    # 128 bits each.
    assert min(len(made.driver), len(made.viewer)) == 22
    assert make_tokens(folder) != made


def test_a_token_and_its_cookie_have_one_role_and_no_other_does() -> None:
    tokens = Tokens(driver="d" * 22, viewer="v" * 22)
    assert (tokens.role("d" * 22), tokens.role("v" * 22)) == ("driver", "viewer")
    assert tokens.role_of_cookie(tokens.cookie("driver")) == "driver"
    assert tokens.role_of_cookie(tokens.cookie("viewer")) == "viewer"
    for wrong in ("", "d" * 21, "D" * 22, "é", tokens.cookie("driver")):
        assert tokens.role(wrong) is None
    for wrong in ("", "d" * 22, tokens.cookie("driver")[:-1]):
        assert tokens.role_of_cookie(wrong) is None


def test_new_tokens_end_the_sessions_of_the_old_ones(tmp_path: Path) -> None:
    before, after = make_tokens(tmp_path), make_tokens(tmp_path)
    assert after.role_of_cookie(before.cookie("driver")) is None


def test_a_file_that_others_may_read_or_that_is_no_such_file_is_refused(tmp_path: Path) -> None:
    make_tokens(tmp_path)
    path = tmp_path / FILE
    path.chmod(0o644)
    with pytest.raises(ConfigError, match=r"read by other users.*--new-tokens"):
        read_tokens(tmp_path)
    path.chmod(0o600)
    for text in ("", "{", '{"driver": "a", "viewer": "b"}', f'{{"driver": "{"a" * 22}"}}'):
        path.write_text(text)
        with pytest.raises(ConfigError, match=r"--new-tokens"):
            read_tokens(tmp_path)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_cannot_be_written_to_is_named(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(ConfigError, match=r"cannot be kept"):
        make_tokens(tmp_path)


def test_a_file_in_the_place_of_the_folder_is_named(tmp_path: Path) -> None:
    (tmp_path / "state").write_text("")
    with pytest.raises(ConfigError, match=r"cannot be kept"):
        make_tokens(tmp_path / "state")
