"""The daemon and all that it needs to drive the wheels: from the boards' bytes to the bus.

It imports no other door of yahboomd, and it only shrinks: what is new stands behind another one.
"""
