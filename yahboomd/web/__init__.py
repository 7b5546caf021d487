"""The page on the phone: its server, access to it, and control of the robot from it.

An ordinary client of the bus in a process of its own. :mod:`.page_commands` decides which commands
of a page are obeyed, :mod:`.page_hub` sends samples to all pages, :mod:`.web_application` serves
HTTP, :mod:`.page_tools` calibrates, records and explains stops.
"""
