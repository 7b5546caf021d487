import asyncio
import threading

import pytest
from zenoh_fixtures import eventually

from yahboomd.bus import keys
from yahboomd.bus.services import Response

pytestmark = pytest.mark.realtime


def refusal(reason, _request):
    return Response(payload=reason.encode(), encoding="text/plain")


def payloads(replies):
    return [reply.ok.payload.to_bytes() for reply in replies]


@pytest.fixture
def app(bus, zenoh_app):
    return zenoh_app("client", bus.options.listen[0])


async def test_a_request_arrives_whole_and_its_answer_goes_back_whole(bus, app):
    requests = []

    def handle(request):
        requests.append(request)
        return Response(payload=b"done", encoding="application/json", attachment=b"sequence")

    service = bus.serve(keys.ODOMETRY_RESET, handle, fallback=refusal)
    (reply,) = await app.ask(
        "bot1/yahboomd/odometry/reset?why=test",
        payload=b"{}",
        encoding="application/json",
        attachment=b"gid",
    )
    (request,) = requests
    assert request.key == "yahboomd/odometry/reset"
    assert request.selector == "bot1/yahboomd/odometry/reset"
    assert request.parameters == "why=test"
    assert (request.payload, request.encoding) == (b"{}", "application/json")
    assert request.attachment == b"gid"
    assert str(reply.ok.key_expr) == "bot1/yahboomd/odometry/reset"
    assert reply.ok.payload.to_bytes() == b"done"
    assert str(reply.ok.encoding) == "application/json"
    assert reply.ok.attachment.to_bytes() == b"sequence"
    assert service.counters.answered == 1


async def test_a_request_without_payload_is_empty(bus, app):
    bus.serve(keys.CONFIG, lambda r: Response(payload=b"[%b]" % r.payload), fallback=refusal)
    assert payloads(await app.ask("bot1/yahboomd/config")) == [b"[]"]


async def test_a_coroutine_answers_later_and_others_meanwhile(bus, app):
    go = asyncio.Event()

    async def slow(_request):
        await go.wait()
        return Response(payload=b"slow")

    bus.serve(keys.BOARD, slow, fallback=refusal)
    bus.serve(keys.CONFIG, lambda _: Response(payload=b"quick"), fallback=refusal)
    waiting = asyncio.create_task(app.ask("bot1/yahboomd/board"))
    assert payloads(await app.ask("bot1/yahboomd/config")) == [b"quick"]
    assert not waiting.done()
    go.set()
    assert payloads(await waiting) == [b"slow"]


async def test_a_failing_handler_answers_by_the_fallback(bus, app, caplog):
    async def later(_request):
        raise ValueError("broken later")

    def at_once(_request):
        raise ValueError("broken at once")

    services = [
        bus.serve(keys.BOARD, at_once, fallback=refusal),
        bus.serve(keys.CONFIG, later, fallback=refusal),
    ]
    for key in (keys.BOARD, keys.CONFIG):
        (answer,) = payloads(await app.ask(f"bot1/{key}"))
        assert b"failed" in answer
    assert [service.counters.failed for service in services] == [1, 1]
    assert "broken later" in caplog.text
    assert "broken at once" in caplog.text


async def test_the_fallback_sees_what_it_answers(bus, app):
    def broken(_request):
        raise ValueError("broken")

    def echo(_reason, request):
        return Response(payload=request.payload, attachment=request.attachment)

    bus.serve(keys.ODOMETRY_RESET, broken, fallback=echo)
    (reply,) = await app.ask("bot1/yahboomd/odometry/reset", payload=b"\0", attachment=b"gid")
    assert reply.ok.payload.to_bytes() == b"\0"
    assert reply.ok.attachment.to_bytes() == b"gid"


async def test_a_query_for_everything_reaches_no_handler(bus, app):
    requests = []
    service = bus.serve(keys.ODOMETRY_RESET, requests.append, fallback=refusal)
    (answer,) = payloads(await app.ask("bot1/**"))
    assert b"full name" in answer
    assert requests == []
    assert service.counters.refused == 1


async def test_an_estop_may_be_asked_for_by_wildcards(bus, app):
    def engage(request):
        return Response(payload=request.selector.encode())

    bus.serve(keys.ESTOP, engage, fallback=refusal, wildcards=True, urgent=True)
    assert payloads(await app.ask("*/yahboomd/estop")) == [b"*/yahboomd/estop"]


async def test_too_large_a_request_is_refused_by_the_fallback(bus, app):
    requests = []
    bus.serve(keys.BOARD, requests.append, fallback=refusal, max_bytes=100)
    (answer,) = payloads(await app.ask("bot1/yahboomd/board", payload=b"x" * 101))
    assert b"more bytes" in answer
    assert requests == []


async def test_where_any_payload_counts_too_large_a_request_arrives_empty(bus, app):
    requests = []

    def engage(request):
        requests.append(request)
        return Response(payload=b"engaged")

    bus.serve(keys.ESTOP, engage, fallback=refusal, max_bytes=100, keep_oversize=True)
    assert payloads(await app.ask("bot1/yahboomd/estop", payload=b"x" * 101)) == [b"engaged"]
    assert (requests[0].oversize, requests[0].payload) == (True, b"")
    assert requests[0].head == b"x" * 16


async def test_the_beginning_of_a_request_is_there_unless_it_is_huge(bus, app):
    heads = []

    def note(reason, request):
        heads.append(request.head)
        return refusal(reason, request)

    bus.serve(keys.BOARD, lambda _: Response(payload=b""), fallback=note, max_bytes=100)
    for size in (101, 65_536, 65_537):
        await app.ask("bot1/yahboomd/board", payload=b"\0\1" + bytes(size - 2))
    assert heads == [b"\0\1" + bytes(14)] * 2 + [b""]


async def test_every_one_of_too_many_queries_is_answered(bus, app):
    service = bus.serve(
        keys.BOARD, lambda _: Response(payload=b"answered"), fallback=refusal, pending=2
    )
    handlers = [app.session.get("bot1/yahboomd/board", timeout=20) for _ in range(50)]
    # The loop stands still here: two requests fit into the lane, the others are refused.
    pause = threading.Event()
    while service.counters.refused < 48:
        pause.wait(0.001)
    answers = []
    for handler in handlers:
        answers += payloads(await asyncio.to_thread(list, handler))
    assert answers.count(b"answered") == 2
    assert answers.count(b"Too many requests at once.") == 48


async def test_a_request_under_way_is_answered_when_the_bus_closes(bus, app):
    entered = asyncio.Event()

    async def never(_request):
        entered.set()
        await asyncio.Event().wait()
        raise AssertionError

    bus.serve(keys.BOARD, never, fallback=refusal)
    waiting = asyncio.create_task(app.ask("bot1/yahboomd/board"))
    await entered.wait()
    assert await bus.close()
    (answer,) = payloads(await waiting)
    assert b"shut down" in answer


async def test_an_asker_that_is_gone_is_counted(bus, app):
    go = asyncio.Event()

    async def slow(_request):
        await go.wait()
        return Response(payload=b"x")

    service = bus.serve(keys.BOARD, slow, fallback=refusal)
    app.session.get("bot1/yahboomd/board", timeout=20)
    await eventually(lambda: service.counters.requests)
    app.session.close()
    await eventually(lambda: not bus.neighbours)
    go.set()
    await eventually(lambda: service.counters.answered + service.counters.unsent)
