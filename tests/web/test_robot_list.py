"""Other robots on the page: whatever package lists them."""

from __future__ import annotations

from typing import Any

import pytest
from zenoh_fixtures import free_endpoint

pytestmark = pytest.mark.realtime


class Fleet:
    """Two robots, and whether somebody stops them."""

    stopping = False

    def shown(self) -> dict[str, Any]:
        return {"robots": ["bot1", "bot2"], "stopping": self.stopping}

    def stop(self) -> None:
        self.stopping = True

    async def close(self) -> None:
        self.stopping = False


async def test_without_a_session_nobody_sees_or_stops_them_and_a_viewer_does_both(
    site: Any,
) -> None:
    fleet = Fleet()
    served = await site(endpoint=free_endpoint(), phones=True, fleet=fleet)
    for method, path in (("GET", "/fleet"), ("POST", "/fleet/stop")):
        assert (await served.request(method, path))[0] == 401
    viewer = served.cookie("viewer")
    foreign = {"Origin": "http://evil.example", **viewer}
    assert (await served.request("POST", "/fleet/stop", **foreign))[0] == 403
    assert not fleet.stopping
    status, _, body = await served.request("GET", "/fleet", **viewer)
    assert (status, b"bot2" in body, fleet.stopping) == (200, True, False)
    assert (await served.request("POST", "/fleet/stop", **viewer))[0] == 200
    assert fleet.stopping


async def test_a_page_without_a_list_has_no_such_view(site: Any) -> None:
    served = await site(endpoint=free_endpoint())
    page = await served.page()
    assert page.of("hello")[-1]["fleet"] is False
    assert (await served.request("GET", "/fleet"))[0] == 404
    assert (await served.request("POST", "/fleet/stop"))[0] == 404
