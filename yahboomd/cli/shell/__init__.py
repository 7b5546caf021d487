"""``completions`` and man pages, made from the command line as data.

``command_tree`` reads argparse's parsers, ``completions`` and ``manual`` write what shells and man
show, and ``shared_files`` puts all of it below a folder ``share``.
"""
