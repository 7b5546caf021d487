"""The true size of the wheels and of the track, from counts and measurements.

Pure: arrays in, numbers with their deviation out. `runs` holds what was driven and measured;
`least_squares` finds the factors that explain it best, `sensor` those that explain the poses of
another sensor; `verdict` says whether they can be trusted. `hand_turn` finds how an inertial sensor
is mounted, by a turn of the robot by hand; `wiring` how the motors are connected.
"""
