"""The controller without ROS: samples in, answers out."""
