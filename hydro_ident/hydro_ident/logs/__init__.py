"""Other people's logs: as columns, by a mapping to a bag, and a mapping to start from."""
