"""ROS 2 without ROS: topics read and written over DDS, with Cyclone DDS's Python package; and a node for ROS itself."""
