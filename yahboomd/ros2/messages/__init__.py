"""ROS 2's encoding and names: bytes of its messages, keys, liveliness tokens and type hashes.

`ros2_encoders` writes CDR, `planar` a base in the plane as ROS 2 has it, `rcl_interfaces` answers
for parameters, `ros2_names` has the names on Zenoh. Pure. `core/messages/cdr.py` reads CDR.
"""
