"""``completions`` and man pages, made from the options of the commands.

``command_tree`` reads argparse's parsers, ``completions`` writes scripts for shells, ``manual``
writes man pages, and ``shared_files`` puts them all below a folder ``share``.
"""
