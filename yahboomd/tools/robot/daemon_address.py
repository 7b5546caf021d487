"""Finds the endpoints of the daemon that a configuration describes."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from yahboomd.core.bus.options import BusOptions
    from yahboomd.core.config import Config


def configured_endpoints(config: Config) -> tuple[str, ...]:
    """The endpoints at which the configured daemon can be reached from this machine.

    A listening address for every interface becomes one of this machine.
    """
    own = (
        endpoint.replace("/0.0.0.0:", "/127.0.0.1:").replace("/[::]:", "/[::1]:")
        for endpoint in (config.zenoh.listen if config.zenoh.mode != "client" else ())
    )
    return tuple(dict.fromkeys((*own, *config.zenoh.connect)))


def client_options(endpoints: tuple[str, ...], config: Config) -> BusOptions:
    """Options for a client of the daemon that a configuration describes."""
    import logging

    from yahboomd.client import connection

    # Commands report these things themselves, in their own words.
    logging.getLogger("yahboomd.client").addHandler(logging.NullHandler())
    zenoh = config.zenoh
    return connection.client_options(
        endpoints, namespace=zenoh.namespace, zenoh_file=zenoh.config or None
    )
