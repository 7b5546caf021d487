"""The Zenoh bus. `bus.Bus` declares publishers, subscriptions and services on it.

It opens and closes within bounds, carries bytes to the event loop, and knows nothing of what they
mean. `keys` has their names, `options` what becomes Zenoh's configuration.
"""
