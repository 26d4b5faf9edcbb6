"""Geometry without a sensor: angles, rotations, the ellipsoid and its sections, an even grid of the sphere."""
