"""Counters of robots in Prometheus' format: the page, and the HTTP listener that serves it.

`robot_metrics` turns samples of robots into metrics, `exposition` writes the text, and
`http_listener` answers scrapers.
"""
