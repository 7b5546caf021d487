"""The messages of the bus: native messages, their codecs, and ROS 2's encoding and names.

`native` defines the messages, `codecs` encodes them in JSON and MessagePack, `cdr` and `ros2` for
ROS 2, and `generate` writes `schemas/`. Pure: invalid input becomes a value, never an exception.
"""
