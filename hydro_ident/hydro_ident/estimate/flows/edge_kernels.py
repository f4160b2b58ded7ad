"""Compiled integrals of the edges' flows: the diagnosis asks for them thousands of times."""

from __future__ import annotations

from numba import njit

from hydro_model.hydraulics.root_kernels import root
from hydro_model.robot import FloatArray


@njit(cache=True, error_model="numpy")
def integrate_edges(
    late: FloatArray,
    soon: FloatArray,
    fraction: float,
    step_s: float,
    pressure: FloatArray,
    supply: FloatArray,
    tank: FloatArray,
    side_a: bool,
    out: FloatArray,
) -> None:
    """Volumes through both edges of a chamber at unit coefficients, interval by interval.

    Parameters
    ----------
    late, soon : (N - 1,) array
        Signal at the interval's start and after its change.
    fraction : float
        Share of the interval that the first of them lasts.
    step_s : float
    pressure, supply, tank : (N,) array
    side_a : bool
        Of chamber A; chamber B is fed while the signal is negative.
    out : (2, N - 1) array
        Filled: while u > 0, and while u <= 0, m^3 per unit coefficient. Unknown where the signal
        is.
    """
    for k in range(out.shape[1]):
        out[0, k] = out[1, k] = 0.0
        for part in range(2):
            signal, share, middle = late[k], fraction, 0.5 * fraction
            if part == 1:
                signal, share, middle = soon[k], 1.0 - fraction, 0.5 * (1.0 + fraction)
            if share <= 0.0:
                continue
            p = pressure[k] + middle * (pressure[k + 1] - pressure[k])
            fed = (signal > 0.0) == side_a
            if fed:
                rail = supply[k] + middle * (supply[k + 1] - supply[k])
                flow = root(rail - p) * abs(signal)
            else:
                rail = tank[k] + middle * (tank[k + 1] - tank[k])
                flow = -root(p - rail) * abs(signal)
            if signal > 0.0:
                out[0, k] += flow * share * step_s
            else:
                out[1, k] += flow * share * step_s
