"""Studies on the simulated rig, without ROS and without a bus."""
