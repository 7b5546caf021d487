"""The command ``blackbox``: where boxes are, their story in words, and their export as MCAP."""
