"""The serial port: opened and owned, written, polled, stopped and probed.

:class:`~yahboomd.link.session.Session` owns one connection for the daemon. `outbox` and `writer`
decide what is sent next, `reception` and `poller` get readings, `stopping` and `seize` stop the
wheels on every way out.
"""
