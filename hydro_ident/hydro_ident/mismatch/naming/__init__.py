"""Name: trials weighed against each other, to sets that recordings cannot tell apart."""
