"""Wishes to safe wheel speeds: who drives, how fast, which wheel, whether it obeys. Pure."""
