"""The emergency stop: engaged and remembered (`latch`), and over a Unix socket (`local_stop`)."""
