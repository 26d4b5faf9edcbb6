"""Logs of autopilots and of ROS, and the calibration that was in force in them."""
