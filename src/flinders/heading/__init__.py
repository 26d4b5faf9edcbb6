"""From corrected fields to headings: attitude, compass deviation, and what a wrong calibration costs in degrees."""
