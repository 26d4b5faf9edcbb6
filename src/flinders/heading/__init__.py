"""From corrected fields to headings: attitude, compass deviation, and heading errors from errors of a calibration."""
