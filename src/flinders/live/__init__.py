"""Live: sensors and vehicles at the other end of a wire.

`transports` carry bytes. `recorder` writes what arrives to a file, as the text that `transcript` makes of it, and hands
on `readings`; so do `feeds` of other kinds, `simulated` and a vehicle on `mavlink`. `motioncal` sends a calibration
to a board, `mavlink_parameters` to a vehicle.

The page: `session` is a pure reducer of readings and commands, with a `buffer` of readings and excluded time;
`evaluation` fits a snapshot of it, says where to turn, and fits all readings in the end; `page_state` is what a page
shows of it, `messages` the wire format. `session_file` is the recording with what a person did. `hub` asks a feed on a
thread, puts its readings into the session and wakes the pages; `server` has the routes, `access` the address and who
may look. `guided` is the session without all that, for programs with a page of their own.
"""
