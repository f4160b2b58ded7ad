"""The bridge without bus, threads and ROS: ways in, ways out and the state between them."""
