"""Effects of the catalogue that are tried: where, in which shapes, and what each gains."""
