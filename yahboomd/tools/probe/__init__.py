"""``probe``: names the board, explains what is wrong, and stores its settings.

``probe_report`` puts together what was found, ``probe_text`` has it in words, ``probe_write``
prints what is stored, ``probe_client`` asks the daemon that holds the port.
"""
