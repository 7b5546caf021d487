import asyncio
import threading

import pytest
from zenoh_fixtures import eventually

from yahboomd.core.bus import keys
from yahboomd.core.bus.bus import LARGE
from yahboomd.core.bus.services import LATER, Response

pytestmark = pytest.mark.usefixtures("fake_zenoh")


def harmless(payload):
    return payload.startswith(b"harmless")


def refusal(reason, _request):
    return Response(payload=reason.encode(), encoding="text/plain")


def payloads(replies):
    return [reply.ok.payload.to_bytes() for reply in replies]


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
    assert (request.payload, request.encoding) == (b"{}", "application/json")
    assert request.attachment == b"gid"
    assert str(reply.ok.key_expr) == "bot1/yahboomd/odometry/reset"
    assert reply.ok.payload.to_bytes() == b"done"
    assert str(reply.ok.encoding) == "application/json"
    assert reply.ok.attachment.to_bytes() == b"sequence"
    assert service.counters.answered == 1


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


async def test_a_query_for_everything_reaches_no_handler(bus, app):
    requests = []
    service = bus.serve(keys.ODOMETRY_RESET, requests.append, fallback=refusal)
    (answer,) = payloads(await app.ask("bot1/**"))
    assert b"full name" in answer
    assert requests == []
    assert service.counters.refused == 1


async def test_what_only_reads_may_be_asked_for_by_wildcards(bus, app):
    def tell(request):
        return Response(payload=request.selector.encode())

    bus.serve(keys.CONFIG, tell, fallback=refusal, wildcards=True)
    assert payloads(await app.ask("*/yahboomd/config")) == [b"*/yahboomd/config"]


async def test_too_large_a_request_is_refused_with_its_beginning_unless_it_is_huge(bus, app):
    requests, heads = [], []

    def note(reason, request):
        heads.append(request.head)
        return refusal(reason, request)

    bus.serve(keys.BOARD, requests.append, fallback=note, max_bytes=100)
    for carried in (
        {"payload": b"\0\1" + bytes(65_534)},
        {"payload": b"\0\1" + bytes(65_535)},
        {"payload": b"x" * 51, "attachment": b"x" * 50},
    ):
        (answer,) = payloads(await app.ask("bot1/yahboomd/board", **carried))
        assert b"more bytes" in answer
    assert requests == []
    assert heads == [b"\0\1" + bytes(14), b"", b"x" * 16]


async def test_too_large_a_request_raises_an_alarm_and_arrives_empty(bus, app):
    requests = []

    def engage(request):
        requests.append(request)
        return Response(payload=b"engaged")

    bus.serve(keys.ESTOP, engage, fallback=refusal, max_bytes=100, harmless=harmless)
    assert payloads(await app.ask("bot1/yahboomd/estop", payload=b"x" * 101)) == [b"engaged"]
    assert (requests[0].oversize, requests[0].payload) == (True, b"")
    assert requests[0].head == b"x" * 16


async def test_every_one_of_too_many_queries_is_answered(bus, app):
    service = bus.serve(
        keys.BOARD, lambda _: Response(payload=b"answered"), fallback=refusal, pending=2
    )
    handlers = [app.session.get("bot1/yahboomd/board") for _ in range(50)]
    # The loop stands still here: two requests fit into the lane, the others are refused.
    assert service.counters.refused == 48
    answers = []
    for handler in handlers:
        answers += payloads(await asyncio.to_thread(list, handler))
    assert answers.count(b"answered") == 2
    assert answers.count(b"Too many requests at once.") == 48


async def test_an_alarm_is_distinguished_from_harmless_samples_as_it_arrives(bus, app):
    def engage(request):
        return Response(payload=b"harmless" if request.harmless else b"engaged")

    bus.serve(keys.ESTOP, engage, fallback=refusal, harmless=harmless)
    for payload, answer in {
        b"harmless": b"harmless",
        b"": b"engaged",
        b"{}": b"engaged",
        b"harmless" + b" " * 57: b"engaged",
    }.items():
        assert payloads(await app.ask("bot1/yahboomd/estop", payload=payload)) == [answer]
    large = {"payload": b"harmless", "attachment": bytes(5000)}
    assert payloads(await app.ask("bot1/yahboomd/estop", **large)) == [b"engaged"]


@pytest.mark.parametrize(
    ("selector", "engages"),
    {
        "bot1/yahboomd/estop?by=me": True,
        "*/yahboomd/estop": True,
        "bot$*/**/estop": True,
        "**": False,
        "bot1/yahboomd/*": False,
        "bot1/yahboomd/estop/**": False,
        "**/$*stop": False,
    }.items(),
)
async def test_a_query_that_names_the_alarm_raises_it_and_one_for_everything_does_not(
    bus, app, selector, engages
):
    requests = []

    def engage(request):
        requests.append(request)
        return Response(payload=b"harmless" if request.harmless else b"engaged")

    service = bus.serve(keys.ESTOP, engage, fallback=refusal, harmless=harmless)
    for payload in (b"", b"harmless" + b" " * 57):
        (answer,) = payloads(await app.ask(selector, payload=payload))
        assert answer == b"engaged" if engages else b"before its last part" in answer
    (answer,) = payloads(await app.ask(selector, payload=b"harmless"))
    assert answer == b"harmless" if engages else b"**/estop" in answer
    assert len(requests) == (3 if engages else 0)
    assert service.counters.refused == (0 if engages else 3)


async def test_an_alarm_outside_the_namespace_takes_its_full_name(bus, app):
    """Its last part is a type, which the services of other nodes share."""
    key = f"0/{keys.ESTOP}/std_srvs::srv::dds_::SetBool_/RIHS01_abc"
    bus.serve(
        f"/{key}", lambda _: Response(payload=b"engaged"), fallback=refusal, harmless=harmless
    )
    assert b"full name" in payloads(await app.ask("**/RIHS01_abc"))[0]
    assert payloads(await app.ask(key)) == [b"engaged"]


async def test_the_alarm_of_a_group_is_raised_by_wildcards_as_the_robots_own_is(bus, app):
    bus.serve(
        "/farm/estop", lambda _: Response(payload=b"engaged"), fallback=refusal, harmless=harmless
    )
    for selector in ("farm/estop", "*/estop", "**/estop"):
        assert payloads(await app.ask(selector)) == [b"engaged"]
    assert b"before its last part" in payloads(await app.ask("farm/**"))[0]


async def test_a_flood_of_harmless_queries_refuses_no_alarm(bus, app):
    """Each kind has a queue of its own; the alarm's is delivered first."""
    order = []

    def engage(request):
        order.append(request.payload)
        return Response(payload=b"answered")

    service = bus.serve(keys.ESTOP, engage, fallback=refusal, pending=2, harmless=harmless)
    for _ in range(50):
        app.session.get("bot1/yahboomd/estop", payload=b"harmless")
    waiting = app.session.get("bot1/yahboomd/estop", payload=b"stop")
    assert (len(service._alarms._entries), service.counters.refused) == (1, 48)
    assert payloads(await asyncio.to_thread(list, waiting)) == [b"answered"]
    await eventually(lambda: len(order) == 3)
    assert order == [b"stop", b"harmless", b"harmless"]


async def test_an_alarm_is_raised_where_its_answer_finds_no_place(bus, app):
    """The last of too many requests are refused, behind others that raise the alarm for them."""
    order = []

    def engage(request):
        order.append(request.payload)
        return Response(payload=b"engaged")

    service = bus.serve(keys.ESTOP, engage, fallback=refusal, pending=2, harmless=harmless)
    handlers = [
        app.session.get("bot1/yahboomd/estop", payload=b"%d" % number) for number in range(5)
    ]
    assert (service.counters.refused, order) == (3, [])
    answers = [payloads(await asyncio.to_thread(list, handler)) for handler in handlers]
    assert answers == [[b"engaged"]] * 2 + [[b"Too many requests at once."]] * 3
    assert order == [b"0", b"1"]


@pytest.mark.parametrize(
    "carried",
    [{"payload": bytes(15_000_000)}, {"attachment": bytes(15_000_000)}, {"parameters": True}],
    ids=["payload", "attachment", "parameters"],
)
async def test_few_large_queries_are_kept_and_all_of_them_raise_the_alarm(bus, app, carried):
    requests, refused = [], []

    def engage(request):
        requests.append(request)
        return Response(payload=b"engaged")

    estop = bus.serve(keys.ESTOP, engage, fallback=refusal, harmless=harmless)
    board = bus.serve(keys.BOARD, refused.append, fallback=refusal)
    count = LARGE + 3
    carried = dict(carried)
    parameters = "?long=" + "x" * 65_536 if carried.pop("parameters", False) else ""
    handlers = [app.session.get(f"bot1/{keys.ESTOP}{parameters}", **carried) for _ in range(count)]
    # Those that were not kept are here without their query, and the loop has seen none yet.
    kept = [pending.query is not None for pending in estop._alarms._entries]
    assert kept == [True] * LARGE + [False] * 3
    other = app.session.get(f"bot1/{keys.BOARD}{parameters}", **carried)
    assert board._lane._entries[0].query is None
    answers = [payloads(await asyncio.to_thread(list, handler)) for handler in handlers]
    assert answers == [[b"engaged"]] * LARGE + [[]] * 3
    assert len(requests) == count
    assert await asyncio.to_thread(list, other) == []
    assert refused == []
    await eventually(lambda: (estop.counters.unsent, board.counters.unsent) == (3, 1))
    # The places are free again.
    assert payloads(await app.ask(f"bot1/{keys.ESTOP}?small")) == [b"engaged"]
    await eventually(lambda: bus._answering.large._value == LARGE)


async def test_an_acknowledgement_does_not_wait_for_other_answers(bus, app):
    bus.serve(
        keys.ESTOP, lambda _: Response(payload=b"engaged"), fallback=refusal, harmless=harmless
    )
    go = threading.Event()
    # As if the answers' thread were held up by an asker that froze.
    bus._answering.answers.send(go.wait)
    assert payloads(await app.ask(f"bot1/{keys.ESTOP}")) == [b"engaged"]
    go.set()


async def test_a_handler_whose_answers_take_long_holds_few_queries(bus, app, turns):
    """The handler's immediate work is done; the answer reports that there are too many."""
    go, begun = asyncio.Event(), []

    def handle(request):
        begun.append(request)

        async def later():
            await go.wait()
            return Response(payload=b"later")

        return later()

    bus.serve(keys.ESTOP, handle, fallback=refusal, pending=LATER, harmless=harmless)
    count = LATER + 5
    handlers = []
    for number in range(count):
        handlers.append(app.session.get(f"bot1/{keys.ESTOP}"))
        await turns()
        assert len(begun) == number + 1
    for handler in handlers[LATER:]:
        answers = payloads(await asyncio.to_thread(list, handler))
        assert answers == [b"Too many requests at once."]
    go.set()
    for handler in handlers[:LATER]:
        assert payloads(await asyncio.to_thread(list, handler)) == [b"later"]


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
    app.session.get("bot1/yahboomd/board")
    await eventually(lambda: service.counters.requests)
    app.session.close()
    await eventually(lambda: not bus.neighbours)
    go.set()
    await eventually(lambda: service.counters.answered + service.counters.unsent)
