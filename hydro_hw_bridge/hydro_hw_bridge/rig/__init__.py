"""The simulated machine on the bus, with a truth plant that shares no code with the model."""
