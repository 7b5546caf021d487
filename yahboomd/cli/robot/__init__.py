"""``status``, ``pose``, ``send``, ``call`` and ``events``: a robot from a shell script."""
