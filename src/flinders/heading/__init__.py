"""From corrected fields to headings: attitude, compass deviation, and what an error of the calibration costs in degrees."""
