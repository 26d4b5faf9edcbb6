"""Live: sensors and vehicles at the other end of a wire.

`sources` are the wires. `recorder` keeps what comes in, in one of the `sinks`, as the text that `transcript` makes of
it by what `lines` recognises, and hands on `readings`; so do `feeds` that are no wires, `simulated` and `telemetry`.
`motioncal` sends a calibration to a board, and `plan` to a vehicle that `mavlink` speaks to.
"""
