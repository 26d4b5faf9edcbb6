"""Live: sensors and vehicles at the other end of a wire.

`transports` carry bytes. `recorder` writes what arrives to a file, as the text that `transcript` makes of it, and hands
on `readings`; so do `feeds` of other kinds, `simulated` and a vehicle on `mavlink`. `motioncal` sends a calibration
to a board, `mavlink_parameters` to a vehicle.

The page has the session, in JavaScript (``static/standalone/session.js``). `hub` asks a feed on a thread, holds its
readings in a `buffer` and passes them on; `messages` is the wire format. `session_file` is the recording with what a
person did, `finished` the calibration of all that it holds. `server` has the routes, `access` the address and who may
look. `guided` is a session for programs with a display of their own.
"""
