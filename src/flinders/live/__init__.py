"""Live: sensors and vehicles at the other end of a wire.

`sources` are the wires; `recorder` keeps what comes in, as the rows that `lines` makes of it, in one of the `sinks`;
`motioncal` sends a calibration to a board, and `plan` to a vehicle that `mavlink` speaks to.
"""
