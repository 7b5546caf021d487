"""The command line: `main` finds the command, and each command has a file.

Families have folders: `stop`, `probe`, `robot` (for scripts), `screens` (monitor and drive),
`service` (install and uninstall) and `shell` (completions and man pages).
"""
