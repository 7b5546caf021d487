"""The work of each command, a folder each: functions that the command line and the page call."""
