"""Two calibrations or more: held against each other, merged, cross-validated, and the sensors of one body."""
