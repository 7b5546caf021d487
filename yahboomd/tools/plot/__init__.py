"""``plot``: a recording as one picture. ``recorded_series`` reads it, ``plot`` draws it."""
