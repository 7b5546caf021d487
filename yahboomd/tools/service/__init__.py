"""``install`` and ``uninstall``: the systemd service, its user, udev rule and configuration.

``install_plan`` decides which files go where, and writes nothing.
"""
