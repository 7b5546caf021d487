"""Ports that a tool opens itself: guards for turning wheels, single pulses, a board's report."""
