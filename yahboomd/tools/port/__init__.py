"""Ports that a tool holds itself: opened and guarded, single pulses, what a board reports."""
