"""Comparison and merging of calibrations, cross-validation of methods, and joint fits of several magnetometers."""
