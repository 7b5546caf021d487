"""Metrics of robots, for Prometheus and its like: the page, and the door where it is read."""
