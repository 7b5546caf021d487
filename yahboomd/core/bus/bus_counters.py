"""Counters of all publishers, subscriptions and services of a bus, in one table."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from yahboomd.core.bus.presence import TokenWatch
from yahboomd.core.bus.publishers import BusPublisher
from yahboomd.core.bus.services import Service
from yahboomd.core.bus.subscriptions import Subscription


def summed_counters(declared: Iterable[object]) -> dict[str, int]:
    """Sum their counters up.

    Consumers count the delivered samples. The losses of a ring of Zenoh's in a flood are unknown;
    ``samples_dropped`` counts at least one for each full ring.
    """
    found: Counter[str] = Counter()
    for each in declared:
        if isinstance(each, BusPublisher):
            found["puts"] += each.counters.puts
            found["put_errors"] += each.counters.errors
        elif isinstance(each, Subscription):
            found["samples_dropped"] += each.counters.dropped
            found["samples_oversize"] += each.counters.oversize
            found["floods"] += each.counters.floods
        elif isinstance(each, Service):
            found["requests"] += each.counters.requests
            found["requests_refused"] += each.counters.refused
            found["requests_failed"] += each.counters.failed
            found["answers_unsent"] += each.counters.unsent
        elif isinstance(each, TokenWatch):
            found["tokens_ignored"] += each.ignored
    return dict(found)
