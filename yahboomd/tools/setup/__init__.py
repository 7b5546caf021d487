"""``setup``: finds out how the motors are connected, and writes ``robot.toml``.

``setup_wizard`` leads through it: ``description`` asks what the robot is, ``motor_turns`` turns the
motors one at a time and asks what was seen, ``robot_drawing`` draws the robot, ``robot_file``
writes the file. What follows from the answers is in
:mod:`yahboomd.tools.calibrate.estimates.wiring`.
"""
