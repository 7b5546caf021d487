"""The Rosmaster expansion board, as its firmware's source defines it: board, cars and sensor."""
