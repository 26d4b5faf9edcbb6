"""Geometry: angles, rotations, ellipsoids, ellipses of turns in one plane, and tiles of the sphere."""
