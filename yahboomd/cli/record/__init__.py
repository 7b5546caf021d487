"""``record``: writes what is on the bus to MCAP files.

``record`` subscribes, writes and reports; ``recorded_topics`` says which keys are recorded, and by
which schema a message of each is read.
"""
