"""Studies on the simulated rig, without ROS and without a bus.

Shared arguments: `plain`: the machine before anything is concealed in it; `work`: folder of what
is made on the way; `source`: random numbers that choose a fault; `kind`: what is varied.
"""
