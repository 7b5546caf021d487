"""The emergency stop: its latch, its local socket, and reports that follow its bytes."""
