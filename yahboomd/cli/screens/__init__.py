"""``monitor`` and ``drive``: a robot on the screen of a terminal, and its keys."""
