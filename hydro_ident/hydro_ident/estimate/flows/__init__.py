"""Chambers and valves: balances, command delay, bulk modulus, edges and rails."""
