"""The work of each command: a folder each, with functions for command line and page alike."""
