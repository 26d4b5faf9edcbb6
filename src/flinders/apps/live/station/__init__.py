"""A station of a production line: tests units one by one, each with serial number, result and row of a table.

- `plan`: the file of a station: pass limits, motion, serial numbers, exports
- `bench`: the current test, from serial number to row; `recordings`: a file for each unit
- `limits`: missed pass limits; `words`: sentences on these; `table`: the rows
- `routes`: requests of the operator's page, whose modules are in ``static/station``
- `gauge`: repeatability and reproducibility of a table's numbers; `gauge_pages`: their output
- `certificate`: a calibration as a Digital Calibration Certificate
"""
