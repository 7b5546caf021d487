"""Links, cookies and sessions, as phones and outsiders ask for them on real sockets."""

from __future__ import annotations

import asyncio
import json
from typing import Any

import pytest
from web_site import ZERO
from websockets.exceptions import InvalidStatus
from zenoh_fixtures import eventually, free_endpoint

from yahboomd.web.page_hub import SESSION_ENDED
from yahboomd.web.session_files import PREFIX

pytestmark = pytest.mark.realtime

PHONE = {"User-Agent": "Mozilla/5.0 (Linux; Android 14)"}


def login(token: str) -> bytes:
    return json.dumps({"token": token}).encode()


async def enter(served: Any, token: str, **headers: str) -> tuple[int, str, str]:
    """Open a link; the status, the cookie, and the words of a refusal."""
    status, answer, body = await served.request("POST", "/session", login(token), **headers)
    words = json.loads(body)["text"] if body else ""
    return status, answer.get("set-cookie", "").split("; ")[0], words


@pytest.mark.parametrize("role", ["driver", "viewer"])
async def test_a_token_becomes_a_cookie_that_scripts_cannot_read(site: Any, role: str) -> None:
    served = await site(endpoint=free_endpoint(), phones=True)
    status, _, body = await served.request("GET", "/session")
    assert (status, "has no session" in json.loads(body)["text"]) == (401, True)
    token = served.link(role)
    status, headers, body = await served.request("POST", "/session", login(token))
    assert (status, body) == (204, b"")
    cookie, *attributes = headers["set-cookie"].split("; ")
    assert {each.lower() for each in attributes} >= {
        *("httponly", "samesite=strict", "path=/", "max-age=2592000")
    }
    assert token not in cookie
    status, again, body = await served.request("GET", "/session", Cookie=cookie)
    assert (status, json.loads(body)["role"]) == (200, role)
    # Each start of the page counts as use.
    assert again["set-cookie"] == headers["set-cookie"]
    page = await served.open(additional_headers={"Cookie": cookie})
    assert (await page.one("hello"))["role"] == role
    stored = b"".join(path.read_bytes() for path in served.state.iterdir())
    assert cookie.partition(".")[2].encode() not in stored


async def test_a_link_lets_one_phone_in_and_its_replay_is_refused_counted_and_explained(
    site: Any,
) -> None:
    served = await site(endpoint=free_endpoint(), phones=True)
    token = served.link()
    assert (await enter(served, token))[0] == 204
    status, cookie, words = await enter(served, token)
    assert (status, cookie) == (403, "")
    assert words.startswith("This link was used already: it lets one phone in, once.")
    assert "yahboomd web --show-link" in words
    assert served.sessions.refused == {"used": 1}
    assert len(served.sessions.all) == 1
    _, _, words = await enter(served, "x" * 22)
    assert "does not know this link" in words
    # A phone that has a session keeps it, whatever link of its history it opens.
    _, cookie, _ = await enter(served, served.link())
    assert (await enter(served, token, Cookie=cookie))[0] == 403
    assert (await served.request("GET", "/session", Cookie=cookie))[0] == 200


async def test_of_many_phones_with_the_same_link_at_once_one_gets_in(site: Any) -> None:
    served = await site(endpoint=free_endpoint(), phones=True)
    token = served.link()
    answers = await asyncio.gather(*(enter(served, token) for _ in range(8)))
    assert sorted(status for status, _, _ in answers) == [204] + [403] * 7
    assert [path.name[: len(PREFIX)] for path in served.state.iterdir()] == [PREFIX]


async def test_without_a_token_or_with_a_wrong_one_no_one_gets_in(site: Any) -> None:
    served = await site(endpoint=free_endpoint(), phones=True)
    link, cookie = served.link(), served.cookie()["Cookie"]
    for wrong in ("", "x" * 22, link[:-1], cookie.partition("=")[2]):
        status, headers, _ = await served.request("POST", "/session", login(wrong))
        assert status == 403
        assert "set-cookie" not in headers
    deep = b'{"x": ' + b"[" * 2000
    for body in (b"", b"{}", b"[]", b'{"token": 1}', b"\xff", deep):
        assert (await served.request("POST", "/session", body))[0] == 400
    number, _, key = cookie.partition("=")[2].partition(".")
    other = "0" if key[-1] != "0" else "1"
    named = f"yahboomd-{served.port}="
    forged = (number, f"{number}.", f".{key}", f"{number}.{key[:-1]}{other}", f"000000.{key}")
    for cookie in ("", *(named + each for each in (*forged, link, "\u00e9"))):
        assert (await served.request("GET", "/session", Cookie=cookie))[0] == 401
        assert (await served.request("POST", "/estop", Cookie=cookie))[0] == 401
        assert (await served.request("GET", "/sessions", Cookie=cookie))[0] == 401
        assert (await served.request("POST", f"/sessions/{number}/end", Cookie=cookie))[0] == 401
    for cookie in ("", f"{named}{number}."):
        with pytest.raises(InvalidStatus, match="401"):
            await served.open(additional_headers={"Cookie": cookie} if cookie else {})
    assert len(served.sessions.all) == 1


async def test_guessing_tokens_is_slowed_down_and_the_estop_is_not(
    fake_daemon: Any, site: Any
) -> None:
    daemon = await fake_daemon()
    served = await site(daemon, phones=True)
    answers = [await served.request("POST", "/session", login("wrong")) for _ in range(12)]
    assert [status for status, _, _ in answers] == [403] * 10 + [429] * 2
    assert 1 <= int(answers[-1][1]["retry-after"]) <= 6
    # Not even the right one, which stays valid.
    token = served.link()
    assert (await enter(served, token))[0] == 429
    assert served.sessions.refused == {"unknown": 10, "tries": 3}
    assert len(list(served.state.iterdir())) == 1
    status, _, body = await served.request("POST", "/estop", **served.cookie("viewer"))
    assert (status, json.loads(body)["engaged"]) == (200, True)


async def test_on_loopback_no_token_is_needed(site: Any) -> None:
    served = await site(endpoint=free_endpoint())
    status, _, body = await served.request("GET", "/session")
    assert (status, json.loads(body)["role"]) == (200, "driver")
    assert (await served.request("POST", "/session", login("any")))[0] == 204
    status, _, body = await served.request("GET", "/sessions")
    assert (status, json.loads(body)["sessions"]) == (200, [])
    assert (await served.request("POST", "/sessions/3f9a2c/end"))[0] == 401


async def test_a_driver_sees_and_ends_each_session_and_a_viewer_only_its_own(site: Any) -> None:
    served = await site(endpoint=free_endpoint(), phones=True)
    _, anne, _ = await enter(served, served.link(), **PHONE)
    _, bert, _ = await enter(served, served.link(), **PHONE)
    _, carl, _ = await enter(served, served.link("viewer"))

    async def seen(cookie: str) -> dict[str, dict[str, Any]]:
        _, _, body = await served.request("GET", "/sessions", Cookie=cookie)
        return {each["name"]: each for each in json.loads(body)["sessions"]}

    async def end(number: str, cookie: str) -> int:
        path = f"/sessions/{number}/end"
        status: int = (await served.request("POST", path, Cookie=cookie))[0]
        return status

    found = await seen(anne)
    assert set(found) == {"Android phone", "Android phone 2", "A browser"}
    assert found["Android phone"]["mine"]
    assert not found["Android phone 2"]["mine"]
    assert set(await seen(carl)) == {"A browser"}
    numbers = {name: each["id"] for name, each in found.items()}
    assert await end(numbers["Android phone"], carl) == 403
    assert served.sessions.refused["viewer"] == 1
    assert await end(numbers["Android phone 2"], anne) == 200
    assert await end(numbers["Android phone 2"], anne) == 404
    # The cookie of an ended session is worth nothing.
    for method, path in (("GET", "/session"), ("POST", "/estop"), ("GET", "/recordings")):
        assert (await served.request(method, path, Cookie=bert))[0] == 401
    _, _, body = await served.request("GET", "/session", Cookie=bert)
    assert json.loads(body)["text"].startswith("The session of this phone has ended")
    with pytest.raises(InvalidStatus, match="401"):
        await served.open(additional_headers={"Cookie": bert})
    assert set(await seen(anne)) == {"Android phone", "A browser"}
    assert await end(numbers["A browser"], carl) == 200
    assert (await served.request("GET", "/session", Cookie=carl))[0] == 401


async def test_a_phone_gets_a_name_that_no_other_has(site: Any) -> None:
    served = await site(endpoint=free_endpoint(), phones=True)
    _, anne, _ = await enter(served, served.link())
    _, bert, _ = await enter(served, served.link())

    async def name(cookie: str, text: str) -> tuple[int, str]:
        body = json.dumps({"name": text}).encode()
        status, _, answer = await served.request("POST", "/session/name", body, Cookie=cookie)
        return status, json.loads(answer)["name"]

    assert await name(anne, "  Anne\u202e \n") == (200, "Anne")
    assert await name(bert, "ANNE") == (409, "A browser 2")
    assert await name(bert, "\n") == (409, "A browser 2")
    assert served.sessions.refused == {"name": 2}
    assert (await served.request("POST", "/session/name", b'{"name": "x"}'))[0] == 401
    assert (await served.request("POST", "/session/name", b"[]", Cookie=anne))[0] == 400
    _, _, body = await served.request("GET", "/session", Cookie=anne)
    assert json.loads(body)["name"] == "Anne"
    # Another link on the same phone: it keeps its name, and has one session.
    _, again, _ = await enter(served, served.link("viewer"), Cookie=anne)
    assert (await served.request("GET", "/session", Cookie=anne))[0] == 401
    assert {each.name: each.role for each in served.sessions.all} == {
        "Anne": "viewer",
        "A browser 2": "driver",
    }
    assert (await served.request("GET", "/session", Cookie=again))[0] == 200


async def test_a_session_that_is_ended_while_its_page_drives_stops_the_robot_first(
    fake_daemon: Any, site: Any
) -> None:
    daemon = await fake_daemon()
    served = await site(daemon, phones=True)
    bert = await served.page(name="Bert")
    anne = await served.page(name="Anne")
    await anne.send(type="control", want=True)
    assert (await bert.one("control", page_driver=2))["name"] == "Anne"
    await anne.press(lambda: daemon.velocities)
    (number,) = (each.id for each in served.sessions.all if each.name == "Anne")
    path = f"/sessions/{number}/end"
    assert (await served.request("POST", path, **served.cookie(name="Bert")))[0] == 200
    assert served.hub._commands.driver is None
    assert await anne.close_code() == SESSION_ENDED
    assert anne.socket.close_reason == "The session of this phone was ended by Bert."
    await bert.one("control", page_driver=None)
    await eventually(lambda: daemon.velocities[-1] == ZERO)


async def test_the_robot_is_stopped_before_anything_else_that_the_page_sent_is_read(
    fake_daemon: Any, site: Any
) -> None:
    served = await site(await fake_daemon(), phones=True)
    page = await served.page()
    await page.send(type="control", want=True)
    await page.one("control", mine=True)
    (session,) = served.sessions.all
    # Nothing is awaited in between.
    served.sessions._drop(session, "Over.")
    assert served.hub._commands.driver is None
    assert not served.hub.has_control(session)
    assert session.pages == 0
    assert await page.close_code() == SESSION_ENDED


async def test_a_session_that_ends_while_its_page_connects_opens_none(site: Any) -> None:
    """Nor does it become a page of a robot that everybody may drive."""
    served = await site(endpoint=free_endpoint(), phones=True)
    header = served.cookie("viewer")
    (session,) = served.sessions.all
    attend = served.hub.attend

    async def late(socket: Any, phone: Any) -> None:
        await served.sessions.end(session)
        await attend(socket, phone)

    served.hub.attend = late
    page = await served.open(additional_headers=header)
    assert await page.close_code() == SESSION_ENDED
    assert page.came == []
