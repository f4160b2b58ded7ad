"""The motion that is asked for: references, their paths, and what no motion may exceed."""
