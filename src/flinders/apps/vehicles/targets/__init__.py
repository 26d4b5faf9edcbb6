"""Parameters of autopilots and of ROS: formula, writer and reader of each."""
