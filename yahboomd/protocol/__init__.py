"""Bytes to meanings and back: framing, the dialects of the board, and its settings. Pure."""
