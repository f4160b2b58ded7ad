"""How kernels are compiled and kept; small vectors, linear systems, Runge-Kutta formulas."""
