"""The emergency stop: engaged and remembered (`latch`), over a Unix socket (`local_stop`), and
reported once it was sent (`stop_reports`)."""
