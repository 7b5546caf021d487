"""The true size of the wheels and of the track, from counts and measurements.

Pure: arrays in, numbers with their deviation out. `runs` holds the runs and their measurements;
`least_squares` finds the factors that explain them best, `sideways` the factor of a mecanum base's
sideways motion; `verdict` decides whether they can be trusted. `hand_turn` finds an inertial
sensor's mounting from a turn by hand, `wiring` the connections of the motors, `gear` the motors
that fit a wheel's counts.
"""
