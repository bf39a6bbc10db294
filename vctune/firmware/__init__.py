"""Export a certified design as firmware: C99 with vectors to replay, and ROS 2 parameters."""
