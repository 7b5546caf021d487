"""The command line: ``main`` finds a command and runs it. Each command is a module of its name.

The modules declare options and print results; the work itself is in :mod:`yahboomd.tools`.
``attended`` connects a command to its robot, ``shared_options`` has the options that several
commands share, and ``shell`` makes man pages and completions.
"""
