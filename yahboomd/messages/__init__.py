"""What machines say to each other: the native messages, their codecs, and ROS 2's bytes and names.

Pure: bytes to values and back. Wrong input is answered by a value, never raised.
"""
