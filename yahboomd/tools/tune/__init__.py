"""``tune``: step responses, a dead zone, and gains for a board's speed loop.

``stand`` drives the wheels and checks them (``wheel_faults``, ``line_faults``, ``traces``),
``procedure`` measures, suggests and stores, ``saved`` keeps the board's own values, ``undo``
restores them, ``step_picture`` draws.
"""
