"""A robot's signals in the place of one another, as where two of them were swapped."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hydro_ident.estimate.flows.chambers import Chamber
from hydro_ident.estimate.signals.traces import Trace
from hydro_model.robot import FloatArray, Robot


@dataclass(frozen=True, slots=True)
class Exchange:
    """Which signals stand in the place of a chamber's own.

    Attributes
    ----------
    cylinders : tuple of int
        Whose signals are others; those of the rest stay.
    further : int
        Pressures are those of the cylinder so many further on in the robot's order, round its end.
    crossed : bool
        The other chamber's.
    valves : int
        The valve's signal is that of the cylinder so many further on.
    """

    cylinders: tuple[int, ...] = ()
    further: int = 0
    crossed: bool = False
    valves: int = 0

    @property
    def of_pressures(self) -> bool:
        """Whether pressures are exchanged."""
        return self.crossed or self.further != 0

    def of(self, trace: Trace) -> Trace:
        """A trace with these signals in their places.

        Parameters
        ----------
        trace : Trace
        """
        p_a, p_b = (trace.p_b, trace.p_a) if self.crossed else (trace.p_a, trace.p_b)
        return replace(
            trace,
            p_a=self._placed(trace.p_a, p_a, self.further),
            p_b=self._placed(trace.p_b, p_b, self.further),
            valve_signal=self._placed(trace.valve_signal, trace.valve_signal, self.valves),
        )

    def _placed(self, own: FloatArray, others: FloatArray, further: int) -> FloatArray:
        result, at = own.copy(), np.array(self.cylinders, dtype=np.intp)
        result[:, at] = others[:, (at + further) % own.shape[1]]
        return result

    def words(self, robot: Robot, chamber: Chamber) -> str:
        """What stands in the place of which signal of a chamber.

        Parameters
        ----------
        robot : Robot
        chamber : Chamber
        """
        names = [cylinder.name for cylinder in robot.cylinders]
        if not self.of_pressures:
            other = robot.valve_of(names[(chamber.index + self.valves) % len(names)])
            return f"the signal of {other.name} in the place of {chamber.valve.name}'s"
        side = chamber.side if not self.crossed else "b" if chamber.side == "a" else "a"
        other_name = names[(chamber.index + self.further) % len(names)]
        return f"{other_name}/{side} in the place of {chamber.cylinder.name}/{chamber.side}"


def exchanges(cylinders: tuple[int, ...], count: int) -> list[Exchange]:
    """Every other pressure and every other valve's signal, once for each of these cylinders.

    Parameters
    ----------
    cylinders : tuple of int
        By their indices.
    count : int
        Of the robot's cylinders.

    Returns
    -------
    list of Exchange
        First a cylinder's own chambers, exchanged: the likeliest of all.
    """
    found = [Exchange(cylinders, crossed=True)]
    for k in range(1, count):
        found += [Exchange(cylinders, k), Exchange(cylinders, k, crossed=True)]
        found.append(Exchange(cylinders, valves=k))
    return found
