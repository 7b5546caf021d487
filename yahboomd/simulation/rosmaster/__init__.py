"""The device side of the Rosmaster expansion board, as its firmware's source has it."""
