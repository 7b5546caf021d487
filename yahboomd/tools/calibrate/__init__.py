"""``calibrate``: drives known shapes, asks for measurements, and writes the calibration file.

``calibration`` has the function that command and page call, ``choices`` what they may choose.
``shapes`` moves the robot and gathers its counts, ``wizard`` and ``imu_by_hand`` ask the person,
``dialogue`` asks through a page or another program.
``result`` explains the findings and writes them; the mathematics is in
:mod:`yahboomd.tools.calibrate.estimates`.
"""
