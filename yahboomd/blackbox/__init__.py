"""The black box: the last minute of a daemon, in a ring that outlives it and in saved files.

``records.py`` has the records, ``box_file.py`` the file that they are in. Both are pure.
``box_keeper.BoxKeeper`` is handed to the daemon, which tells it everything.
"""
