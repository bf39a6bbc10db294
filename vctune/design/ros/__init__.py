"""ROS 2 parameter files: their content, their stability, and repairs."""
