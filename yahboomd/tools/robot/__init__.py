"""``status``, ``pose``, ``send``, ``call`` and ``events``: a robot from a shell script.

``attended`` connects to the daemon, runs the command's work and ends it in order on signals;
``obedience`` judges whether the robot does what ``send`` commands.
"""
