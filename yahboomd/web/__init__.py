"""The page on the phone: its server, which page may drive, and who gets in.

An ordinary client of the bus in a process of its own. :mod:`.page_commands` decides what a page may
command, :mod:`.page_hub` sends samples to all pages, :mod:`.web_application` speaks HTTP.
"""
