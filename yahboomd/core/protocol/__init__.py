"""Bytes to readings and commands to bytes: framing, the dialects of boards, and their settings.

`dialect` is the interface of a board, `registry` lists the dialects. Pure: nothing here opens a
port.
"""
