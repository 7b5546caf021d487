"""The command line: ``main`` finds a command, and each command is a file or in a folder of its own.

``screens`` watches and drives a robot from a terminal; ``robot`` does from a shell script; ``stop``
stops wheels, whatever drives them; ``probe`` examines boards; ``service`` installs; ``shell`` makes
man pages and completions. Beside them lie ``run``, ``simulate``, ``config`` and ``metrics``, and
what several share: options, numbers in words, other processes of this machine.
"""
