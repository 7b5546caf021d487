"""``probe``: names the board, explains problems, and stores the board's settings.

``probe_report`` collects the findings, ``probe_text`` puts them into words, ``probe_write`` prints
the progress of storing, ``probe_client`` asks the daemon that holds the port.
"""
