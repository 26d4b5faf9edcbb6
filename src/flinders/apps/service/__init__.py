"""Online calibration as a service: a program that runs on a vehicle for months and keeps its compass calibrated.

For builders of companion computers, gateways and monitors.

- `clocks`: one monotonic time for readings, of the machine or of the recording
- `sources`: a wire, a pipe or recordings, as readings in one unit on that time
- `watching`: calibrates from a source, and writes its state periodically
- `reports`: the state at a time as a line, as JSON and for Prometheus; `kept`: files that are retried after a full disk
- `watch_page`, `timeline_figures`: a page with the state and its history
- `handover`: sends calibrations to the vehicle
- `simulate_boat`: simulated days of a boat, to try the service without a sensor
- ``cli``: the command

`flinders.OnlineCalibration` does the estimation.
"""
