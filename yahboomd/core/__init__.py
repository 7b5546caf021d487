"""The daemon and all that it needs to drive the wheels: from the boards' bytes to the bus.

It imports no other door of yahboomd, and only shrinks: new features stand behind another one.
"""
