"""Read ROS 2 parameter files as problems, check them, repair them, and write designs as such files."""
