"""Effects that a robot file lists, and what is left out."""
