"""Counters of robots in Prometheus' format, and the HTTP listener that serves them.

`robot_metrics` turns samples of robots into metrics, `exposition` writes the text, and
`http_listener` answers scrapers.
"""
