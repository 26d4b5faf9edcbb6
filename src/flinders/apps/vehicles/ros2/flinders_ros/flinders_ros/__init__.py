"""A node that calibrates the magnetometer of a robot while it works."""
