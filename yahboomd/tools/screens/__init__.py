"""``monitor`` and ``drive``: a robot on the screen of a terminal, and its keys.

A feed fills a dashboard with samples from the bus, and the dashboard makes views. rich draws both
screens from a view, and ``sentences`` puts a view into words, also for ``status``. ``keyboard``
cuts a terminal's bytes into keys, ``teleop`` turns keys into velocities, with a deadman.
"""
