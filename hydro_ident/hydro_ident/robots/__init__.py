"""Whether a robot description can be true."""
