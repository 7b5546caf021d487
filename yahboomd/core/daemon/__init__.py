"""The daemon. `service.Daemon` runs the control path between the board and the bus.

`assembly` makes the objects from the configuration, `control` decides what the wheels do,
`supervisor` keeps the board connected, `publisher` and `planes` publish, `requests` answers.
"""
