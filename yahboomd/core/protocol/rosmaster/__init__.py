"""The Rosmaster expansion board: frames with a checksum, body velocities, and what it stores."""
