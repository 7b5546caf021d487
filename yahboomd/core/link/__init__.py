"""The serial port: opened and owned, written, asked, stopped and probed.

:class:`~yahboomd.core.link.session.Session` owns one connection for the daemon. The `line`
receives, and leaves; `outbox` and `writer` choose the next frame, the `poller` gets readings,
`stopping` and `seize` stop the wheels on every way out.
"""
