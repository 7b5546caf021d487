"""``tune``: step responses, a dead zone, and gains for a board's speed loop.

``stand`` drives the wheels and watches them (``wheel_faults``, ``line_faults``, ``traces``),
``procedure`` measures, suggests and stores, ``saved`` keeps the board's values before they change,
``step_picture`` draws, ``tune`` is the command.
"""
