"""Estimators on aligned arrays: base parameters, friction and hydraulics, without ROS.

Shared arguments: `windows`: length and spacing of the flow balances' windows; `residual_std`:
residual of each channel, which weighs it; `rows`: how many were measured, or which.
"""
