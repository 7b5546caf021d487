"""``plot``: draws a recording. ``recorded_series`` reads it."""
