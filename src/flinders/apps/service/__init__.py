"""A calibration that keeps itself while a vehicle works: what runs beside the vehicle's own programs, for months.

For whoever builds a companion computer, a gateway or a monitor.

- `clocks`: puts readings onto one time that never goes back, of the machine or of what was recorded
- `sources`: a wire, a pipe or recordings, as readings in one unit on that time
- `watching`: learns from a source, and writes what is known at times
- `reports`: what is known at a time, as a line, as JSON and for Prometheus; `kept`: files that outlive a full disk
- `watch_page`, `timeline_figures`: the same for people, with its course, as a page
- `handover`: sends calibrations to the vehicle that readings come from
- `simulate_boat`: days of a boat, to try it all without a sensor
- ``cli``: the command

The learning is `flinders.OnlineCalibration`.
"""
