"""The Zenoh bus. `bus.Bus` declares publishers, subscriptions and services on it.

It opens and closes in bounded time, carries bytes to the event loop, and does not know their
meaning. `keys` has their names, `options` makes Zenoh's configuration.
"""
