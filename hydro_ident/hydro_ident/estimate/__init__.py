"""Estimators on aligned arrays: base parameters, friction and hydraulics, without ROS."""
