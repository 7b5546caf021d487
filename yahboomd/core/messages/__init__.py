"""The messages of the bus: native messages and their codecs.

`native` defines the messages, `codecs` encodes them in JSON and MessagePack, and reads commands in
ROS 2's encoding, too, with `cdr`. Pure: invalid input becomes a value, never an exception.
"""
