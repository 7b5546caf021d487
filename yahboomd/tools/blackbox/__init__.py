"""``blackbox``: finds boxes, tells their story in words, and exports them as MCAP."""
