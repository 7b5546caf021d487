"""The sessions of phones, in virtual time."""

from __future__ import annotations

import asyncio
import os
from pathlib import Path

import pytest
from web_site import full_disk

from yahboomd.core.errors import ConfigError
from yahboomd.core.model import NS_PER_S
from yahboomd.simulation.virtual_time import LoopClock, on_virtual_time
from yahboomd.web import phone_sessions
from yahboomd.web.phone_sessions import LIFE_NS, PhoneSession, PhoneSessions
from yahboomd.web.session_files import (
    LINK_NS,
    PREFIX,
    Role,
    end_stored,
    make_entry,
    stored_sessions,
)

DAY_NS = 24 * 3600 * NS_PER_S


class House:
    """The sessions of a server, and what it was told of their ends."""

    def __init__(self, folder: Path, clock: LoopClock | None = None) -> None:
        self.folder = folder
        self.clock = clock or LoopClock()
        self.ended: list[tuple[str, str]] = []
        self.sessions = PhoneSessions(
            folder,
            self.clock,
            ended=lambda session, words: self.ended.append((session.name, words)),
            renamed=lambda: None,
        )
        self.sessions.start()

    async def enter(
        self, name: str = "Anne", role: Role = "driver", former: PhoneSession | None = None
    ) -> tuple[PhoneSession, str]:
        found = await self.sessions.enter(make_entry(self.folder, role, self.clock), name, former)
        assert not isinstance(found, str)
        return found

    def again(self, epoch_ns: int | None = None) -> House:
        """The server after a restart; with another time of day."""
        clock = LoopClock() if epoch_ns is None else LoopClock(epoch_ns)
        clock.slept_ns = self.clock.slept_ns
        return House(self.folder, clock)

    def names(self) -> set[str]:
        return {each.name for each in self.sessions.all}


@on_virtual_time
async def test_each_phone_has_a_cookie_of_its_own_and_they_end_singly(tmp_path: Path) -> None:
    house = House(tmp_path)
    (anne, hers), (bert, his) = await house.enter("Anne"), await house.enter("Bert", "viewer")
    assert house.sessions.of_cookie(hers) is anne
    assert (bert.role, hers != his) == ("viewer", True)
    for wrong in ("", ".", hers[:-1], f"{bert.id}.{hers[7:]}", anne.id, f"{anne.id}.{anne.key}"):
        assert house.sessions.of_cookie(wrong) is None
    assert await house.sessions.end(anne, "Bert ended it.") == ""
    assert house.ended == [("Anne", "Bert ended it.")]
    assert house.sessions.of_cookie(hers) is None
    assert house.sessions.of_cookie(his) is bert
    assert [number for number, *_ in stored_sessions(tmp_path)] == [bert.id]
    # Once more: nothing happens.
    await house.sessions.end(anne)
    assert len(house.ended) == 1


@on_virtual_time
async def test_a_link_is_used_once_and_each_refusal_has_its_reason_and_count(
    tmp_path: Path,
) -> None:
    house = House(tmp_path)
    token = make_entry(tmp_path, "driver", house.clock)
    first = await house.sessions.enter(token, "Anne", None)
    assert not isinstance(first, str)
    assert await house.sessions.enter(token, "Mallory", None) == "used"
    assert await house.sessions.enter("x" * 22, "Mallory", None) == "unknown"
    old = make_entry(tmp_path, "driver", house.clock)
    house.clock.slept_ns = LINK_NS + 1
    assert await house.sessions.enter(old, "Carl", None) == "old"
    assert house.sessions.refused == {"used": 1, "unknown": 1, "old": 1}
    assert house.names() == {"Anne"}
    words = house.sessions.refused_in_words()
    assert words.startswith("links that were used before: 1, links that the robot did not make")
    # After a restart it is not remembered, and does not work either.
    assert await house.again().sessions.enter(token, "Mallory", None) == "unknown"


@on_virtual_time
async def test_of_two_phones_with_one_link_in_the_same_instant_one_gets_in(tmp_path: Path) -> None:
    """Also if two servers use one folder."""
    house = House(tmp_path)
    other = house.again()
    for attempt in range(5):
        token = make_entry(tmp_path, "driver", house.clock)
        found = await asyncio.gather(
            *(each.sessions.enter(token, "Anne", None) for each in (house, other, house, other))
        )
        assert sum(not isinstance(each, str) for each in found) == 1, attempt
        assert len(list(tmp_path.iterdir())) == attempt + 1


@on_virtual_time
async def test_sessions_outlive_the_server_with_their_names(tmp_path: Path) -> None:
    house = House(tmp_path)
    (anne, hers), (_, his) = await house.enter(), await house.enter("Bert", "viewer")
    assert await house.sessions.rename(anne, "Anne's phone") == ""
    again = house.again()
    found = again.sessions.of_cookie(hers)
    assert found is not None
    assert (found.name, found.role, again.names()) == (
        "Anne's phone",
        "driver",
        {"Anne's phone", "Bert"},
    )
    await again.sessions.end(found)
    last = again.again()
    assert (last.names(), last.sessions.of_cookie(hers)) == ({"Bert"}, None)
    assert last.sessions.of_cookie(his) is not None


@on_virtual_time
async def test_the_terminal_ends_a_session_within_seconds(tmp_path: Path) -> None:
    house = House(tmp_path)
    (anne, hers), (_, his) = await house.enter(), await house.enter("Bert")
    looking = asyncio.create_task(house.sessions.run())
    assert end_stored(tmp_path, anne.id)
    while house.ended == []:
        await asyncio.sleep(0.5)
    assert house.ended == [("Anne", "The session of this phone was ended.")]
    assert house.sessions.of_cookie(hers) is None
    assert house.sessions.of_cookie(his) is not None
    looking.cancel()
    await asyncio.gather(looking, return_exceptions=True)


@on_virtual_time
async def test_a_session_lasts_as_long_as_it_is_used_and_thirty_days_beyond(
    tmp_path: Path,
) -> None:
    house = House(tmp_path)
    (_, hers), (bert, his) = await house.enter(), await house.enter("Bert")
    for _ in range(4):
        house.clock.slept_ns += 20 * DAY_NS
        assert house.sessions.of_cookie(hers) is not None
        # An open page uses it.
        bert.pages = 1
        await house.sessions.look()
        bert.pages = 0
    assert house.names() == {"Anne", "Bert"}
    house.clock.slept_ns += LIFE_NS + 1
    # At once, not when somebody looks.
    assert house.sessions.of_cookie(hers) is None
    await house.sessions.look()
    words = "This phone was not used for 30 days."
    assert set(house.ended) == {("Anne", words), ("Bert", words)}
    assert house.sessions.of_cookie(his) is None
    assert list(tmp_path.iterdir()) == []


@on_virtual_time
async def test_the_days_without_the_server_count_too(tmp_path: Path) -> None:
    house = House(tmp_path)
    _, hers = await house.enter()
    now_ns = house.clock.wall_ns() - house.clock.now_ns()
    assert house.again(now_ns + LIFE_NS - DAY_NS).sessions.of_cookie(hers) is not None
    assert house.again(now_ns + LIFE_NS + DAY_NS).sessions.of_cookie(hers) is None


@on_virtual_time
async def test_a_time_of_day_that_jumps_ends_no_session_and_lengthens_none_for_ever(
    tmp_path: Path,
) -> None:
    house = House(tmp_path)
    _, hers = await house.enter()
    # The clock of a running server is corrected by years: it does not matter.
    for epoch_ns in (0, 4_000_000_000 * NS_PER_S):
        house.clock._epoch_ns = epoch_ns
        house.clock.slept_ns += DAY_NS
        await house.sessions.look()
        assert house.sessions.of_cookie(hers) is not None
    # A start before the time is known: the last use is in the future.
    early = house.again(epoch_ns=0)
    assert early.sessions.of_cookie(hers) is not None
    early.clock.slept_ns += LIFE_NS + 1
    assert early.sessions.of_cookie(hers) is None


@on_virtual_time
async def test_the_last_use_is_stored_now_and_then(tmp_path: Path) -> None:
    house = House(tmp_path)
    anne, hers = await house.enter()
    path = tmp_path / f"{PREFIX}{anne.id}"
    before_ns = path.stat().st_mtime_ns
    house.sessions.of_cookie(hers)
    await house.sessions.look()
    assert path.stat().st_mtime_ns == before_ns
    await asyncio.sleep(1000)
    house.sessions.of_cookie(hers)
    await house.sessions.look()
    assert path.stat().st_mtime_ns == pytest.approx(before_ns + 1000 * NS_PER_S, abs=5 * NS_PER_S)


@on_virtual_time
async def test_on_a_full_disk_nobody_gets_in_and_nobody_is_thrown_out(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    house = House(tmp_path)
    anne, hers = await house.enter()
    token = make_entry(tmp_path, "driver", house.clock)
    with full_disk():
        assert await house.sessions.enter(token, "Bert", None) == "disk"
        assert "cannot be stored on the robot" in await house.sessions.rename(anne, "Anna")
        await house.sessions.look()
        assert house.sessions.of_cookie(hers) is anne
    assert house.sessions.refused == {"disk": 2}
    assert "A phone could not be let in: File too large." in caplog.text
    # The link is still good.
    assert not isinstance(await house.sessions.enter(token, "Bert", None), str)
    assert house.names() == {"Anne", "Bert"}


@on_virtual_time
async def test_a_folder_that_cannot_be_read_ends_no_session(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    house = House(tmp_path / "state")
    _, hers = await house.enter()
    (tmp_path / "state").rename(tmp_path / "aside")
    (tmp_path / "state").write_text("")
    await house.sessions.look()
    await house.sessions.look()
    assert house.sessions.of_cookie(hers) is not None
    assert caplog.text.count("cannot be read: Not a directory") == 1
    (tmp_path / "state").unlink()
    await house.sessions.look()
    assert house.sessions.of_cookie(hers) is None


@on_virtual_time
async def test_a_session_that_cannot_be_removed_is_over_nevertheless(tmp_path: Path) -> None:
    house = House(tmp_path / "state")
    anne, hers = await house.enter()
    file = tmp_path / "state" / f"{PREFIX}{anne.id}"
    kept = file.read_bytes()
    file.unlink()
    file.mkdir()
    assert "after a restart of the server" in await house.sessions.end(anne)
    file.rmdir()
    file.write_bytes(kept)
    file.chmod(0o600)
    await house.sessions.look()
    assert house.sessions.of_cookie(hers) is None


@on_virtual_time
async def test_what_others_may_write_is_no_session(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    house = House(tmp_path)
    _, hers = await house.enter()
    (path,) = tmp_path.iterdir()
    path.chmod(0o666)
    again = house.again()
    assert again.sessions.of_cookie(hers) is None
    await again.sessions.look()
    assert caplog.text.count("other users can read it: it is ignored") == 1
    tmp_path.chmod(0o777)
    with pytest.raises(ConfigError, match=r"Other users may write to .*chmod go-w"):
        house.again()


@on_virtual_time
async def test_a_phone_that_is_let_in_again_has_one_session_and_keeps_its_name(
    tmp_path: Path,
) -> None:
    house = House(tmp_path)
    anne, hers = await house.enter("iPhone")
    await house.sessions.rename(anne, "Anne")
    again, cookie = await house.enter("iPhone", "viewer", former=anne)
    assert (again.name, again.role) == ("Anne", "viewer")
    assert house.sessions.of_cookie(hers) is None
    assert house.sessions.of_cookie(cookie) is again
    # One that lost its cookie is another phone for us.
    other, _ = await house.enter("iPhone")
    assert house.names() == {"Anne", "iPhone"}
    assert await house.sessions.rename(other, "anne") == "Another phone has this name."


@on_virtual_time
async def test_there_are_so_many_sessions_and_those_with_a_page_stay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(phone_sessions, "MOST", 3)
    house = House(tmp_path)
    for number in range(3):
        (await house.enter(f"phone {number}"))[0].pages = 1 if number == 0 else 0
        await asyncio.sleep(1)
    await house.enter("phone 3")
    assert house.ended == [("phone 1", "More than 3 phones were let in.")]
    assert house.names() == {"phone 0", "phone 2", "phone 3"}


@on_virtual_time
async def test_a_session_of_a_copied_file_is_taken_up(tmp_path: Path) -> None:
    house = House(tmp_path)
    other = house.again()
    _, hers = await house.enter()
    await other.sessions.look()
    assert other.sessions.of_cookie(hers) is not None
    os.remove(next(tmp_path.iterdir()))
    await other.sessions.look()
    assert other.sessions.of_cookie(hers) is None
