"""``calibrate``: drives known shapes, asks for measurements, and writes the calibration file.

``shapes`` moves the robot and gathers its counts, ``wizard`` and ``imu_by_hand`` ask the person,
``dialogue`` asks through another program, ``recorded_poses`` reads a recording instead. ``result``
explains the findings and writes them; the mathematics is in
:mod:`yahboomd.tools.calibrate.estimates`.
"""
