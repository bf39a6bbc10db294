"""ROS 2 parameter files: their meaning, their check, and their repairs."""
