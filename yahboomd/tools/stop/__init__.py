"""``stop``: every way to stop wheels, and to release the emergency stop.

``stop_local`` reaches the daemons of this machine over their sockets, ``stop_client`` those on the
bus, and ``stop_port`` opens the port itself if no daemon holds it. ``yahboomd.cli.stop`` chooses.
"""
