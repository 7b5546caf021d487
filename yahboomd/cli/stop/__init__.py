"""``stop``: the emergency stop of every daemon, and the port itself where no daemon holds it."""
