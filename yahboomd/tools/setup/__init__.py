"""``setup``: finds out how the motors are connected, and writes ``robot.toml``.

``setup_wizard`` leads through it. ``description`` asks for the motors, the drive and the size;
``motor_turns`` turns the motors one at a time and asks which wheel turned; ``last_look`` checks the
result, ``robot_drawing`` draws the robot, ``robot_file`` writes the file. The conclusions from the
answers are in :mod:`yahboomd.tools.calibrate.estimates.wiring`.
"""
