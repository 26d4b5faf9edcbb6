"""Live: sensors and vehicles at the other end of a wire.

`transports` carry bytes. `recorder` writes what arrives to one of the `sinks`, as the text that `transcript` makes of
it, and hands on `readings`; so do `feeds` of other kinds, `simulated` and `telemetry`.
`motioncal` sends a calibration to a board, `mavlink_parameters` to a vehicle that `mavlink` speaks to.

The page: `session` is a pure reducer of readings and commands, with a `buffer` of readings and `exclusions` of time;
`evaluation` fits a snapshot of it, with `guidance` where to turn; `page_state` is what a page shows of it, `messages`
the wire format. `session_file` is the recording with what a person did, `finish` the calibration of all its readings.
`feed_thread` asks a feed, `hub` puts it into the session and wakes the pages, `access` says who may look, `server` has
the routes, and `listener` the address.
"""
