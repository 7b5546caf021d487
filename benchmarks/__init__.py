"""Measurements of the daemon: ``python -m benchmarks`` writes `docs/benchmarks.md`.

`__main__` lists the benchmarks, one file each; `rig` starts their processes and meters, and
`report` writes the pages. `false_alarms`, `footprint` and the package `soak` have commands of their
own.
"""
