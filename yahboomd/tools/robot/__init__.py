"""``status``, ``pose``, ``send``, ``call`` and ``events``: a robot from a shell script.

``daemon_address`` finds the daemon, ``on_bus`` asks it, ``obedience`` judges whether the robot
does what ``send`` commands, and ``simulated_robot`` builds the robot that ``simulate`` serves.
"""
