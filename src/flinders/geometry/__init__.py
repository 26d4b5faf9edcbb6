"""Geometry: angles, rotations, the ellipsoid and its plane sections, an even grid of the sphere."""
