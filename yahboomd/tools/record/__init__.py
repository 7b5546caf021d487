"""Recordings: MCAP files of what is on the bus, with schemas that other programs read them by.

`mcap_files` writes them, bounded in size and readable up to the last chunk wherever they are cut;
`ros_definitions` has the definitions of the ROS 2 messages in them.
"""
