"""ROS 2 parameter files: what they state, whether it is stable, and what would help."""
