import pytest
from zenoh_fixtures import eventually

from yahboomd.core.bus import keys
from yahboomd.core.bus.bus_counters import summed_counters
from yahboomd.core.bus.services import Response

pytestmark = pytest.mark.realtime


def refusal(reason, _request):
    return Response(payload=reason.encode(), encoding="text/plain")


def test_nothing_declared_is_nothing_seen():
    assert summed_counters([]) == {}
    assert summed_counters([object()]) == {}


async def test_what_is_refused_lost_or_failed_on_the_bus_is_counted(bus, zenoh_app):
    app = zenoh_app("client", bus.options.listen[0])
    pose = bus.publisher(keys.POSE)
    arrivals = []
    bus.subscribe(keys.CMD_VEL, arrivals.extend, max_bytes=8)
    bus.serve(keys.CONFIG, lambda r: Response(payload=b"here"), fallback=refusal)
    bus.serve(keys.BOARD, lambda r: 1 / 0, fallback=refusal, max_bytes=8)
    pose.put(b"{}")
    await app.reach("bot1/cmd_vel")
    app.session.put("bot1/cmd_vel", b"far too large")
    app.session.put("bot1/cmd_vel", b"small")
    await eventually(lambda: arrivals)
    await app.ask("bot1/yahboomd/config")
    await app.ask("bot1/yahboomd/board", payload=b"far too large")
    await app.ask("bot1/yahboomd/board")
    await bus.close()
    pose.put(b"{}")
    found = bus.status_values()
    assert found == {
        "puts": 1,
        "put_errors": 1,
        "samples_dropped": 0,
        "samples_oversize": 1,
        "floods": 0,
        "requests": 2,
        "requests_refused": 1,
        "requests_failed": 1,
        "answers_unsent": 0,
    }
