"""Comparison of two or more calibrations, merging, cross-validation, and joint fits of the sensors of one body."""
