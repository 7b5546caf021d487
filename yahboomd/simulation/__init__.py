"""The device side: boards, motors and a chassis that behave like the real ones.

An independent reading of what the boards do on the wire: nothing here imports the rooms that
speak to a board, so that the two can check each other.

```
host bytes -> wire (pacing, impairments) -> board (firmware) -> plant (motors, chassis)
host bytes <- wire (pacing, impairments) <- board            <- encoders, ground truth
```

``pty`` serves a robot on a real pseudo-terminal in real time, ``memory`` in one process on the
running event loop's time, which ``virtual_time`` moves without waiting.
"""
