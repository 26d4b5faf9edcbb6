"""Live: sensors and vehicles at the other end of a wire.

`sources` are the wires. `recorder` keeps what comes in, in one of the `sinks`, as the text that `transcript` makes of
it by what `lines` recognises, and hands on `readings`; so do `feeds` that are no wires, `simulated` and `telemetry`.
`motioncal` sends a calibration to a board, and `plan` to a vehicle that `mavlink` speaks to.

The page: `session` is a pure reducer of wishes and of readings, which a `track` holds, with `spans` that were taken
out; `snapshot` is one fit of it, `finish` the calibration in the end, `messages` the wire, `store` the file. `pump`
asks a feed in a thread, `access` says who may look, and `server` puts it all together.
"""
