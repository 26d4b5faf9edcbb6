"""Headings from corrected readings, heading errors from errors of a calibration, guidance for turning, and filters."""
