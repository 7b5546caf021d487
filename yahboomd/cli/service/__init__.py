"""``install`` and ``uninstall``: the systemd service, its user, udev rule and configuration."""
