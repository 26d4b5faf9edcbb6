"""A station of a production line: one unit after the other, each with a serial number, a result and a row of a table.

- `plan`: the file of a station: pass limits, motion, serial numbers, exports
- `bench`: the unit that is tested now, from its serial number to its row; `recordings`: a file for each unit
- `limits`: what a calibration misses; `words`: how that is said; `table`: the rows
- `routes`: what the page of the operator asks for, whose modules are in ``static/station``
- `gauge`: repeatability and reproducibility of a table's numbers; `gauge_page`: how they are shown
- `certificate`: a calibration as a Digital Calibration Certificate
"""
