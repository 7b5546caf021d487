"""``calibrate``: drives known shapes, asks what a tape says, and writes the calibration file.

``shapes`` moves the robot and gathers its counts, ``asking`` reads a person's answers, ``result``
explains what was found and writes it; the mathematics is in
:mod:`yahboomd.tools.calibrate.estimates`.
"""
