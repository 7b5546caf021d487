"""Records the messages of the bus as MCAP files, with schemas for other programs.

`bus_recorder` has the functions to call; `mcap_files` writes the files, bounded in size and
readable up to the last complete chunk; `ros_definitions` has the definitions of the ROS 2 messages
in them.
"""
