"""``completions`` and man pages: the command line as data, and what is written from it."""
