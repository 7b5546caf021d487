"""``monitor`` and ``drive``: a robot on the screen of a terminal, and its keys.

A feed fills a dashboard with samples from the bus, and the dashboard gives views. Both screens are
drawn from a view by rich, and ``sentences`` has it in words, for ``status`` too. ``keyboard`` cuts
a terminal's bytes into keys, ``teleop`` makes velocities of them, with a deadman.
"""
