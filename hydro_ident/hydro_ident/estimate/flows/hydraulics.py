"""The command delay, bulk modulus and valve edges of a robot, from its chamber balances."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

from hydro_ident.errors import IdentError
from hydro_ident.estimate.flows.chambers import WindowSettings, chambers_of
from hydro_ident.estimate.flows.cylinder_fit import CylinderFit, combined
from hydro_ident.estimate.flows.delay import Solve, ValveDelay, fit_delay
from hydro_ident.estimate.flows.flow_moments import ExtraColumns, FlowGatherer
from hydro_ident.estimate.flows.unread_rails import RailConstant, settled_constants
from hydro_ident.estimate.signals.traces import Trace
from hydro_ident.estimate.statistics.regression import solve_iv
from hydro_model.robot import Robot

#: Gathers the recordings again, with unread rails off by so many Pa.
Regather = Callable[[Mapping[str, float]], Sequence[FlowGatherer]]


@dataclass(frozen=True, slots=True)
class HydraulicFit:
    """Hydraulic parameters of a robot.

    Attributes
    ----------
    delay_s, delay_std_s : float
        Command delay; the deviation is infinite where the valves did not move.
    cylinders : tuple of CylinderFit
        Those with a valve and at least one chamber recorded.
    windows : WindowSettings
    delay_dof : float
        Degrees of freedom of the delay's deviation.
    longest_s : float
        Longest delay that was tried.
    valve_delays : mapping of str to ValveDelay
        By valve, where they differ: its chambers are fitted at its own.
    rails : tuple of RailConstant
        Of rails that nobody read.
    by_spools : bool
        Openings are measured spools: `valve_delays` are those of what passes behind the readings.
    """

    delay_s: float
    delay_std_s: float
    cylinders: tuple[CylinderFit, ...]
    windows: WindowSettings
    delay_dof: float = math.inf
    longest_s: float = math.inf
    valve_delays: Mapping[str, ValveDelay] = field(default_factory=dict)
    rails: tuple[RailConstant, ...] = ()
    by_spools: bool = False

    def delay_of(self, valve: str) -> float:
        """Delay in s at which a valve's chambers are fitted, by its name."""
        own = self.valve_delays.get(valve)
        return self.delay_s if own is None else own.delay_s


def fit_hydraulics(
    robot: Robot,
    traces: Sequence[Trace],
    windows: WindowSettings | None = None,
    extra: ExtraColumns | None = None,
) -> HydraulicFit | None:
    """Fit the command delay, then every chamber, then combine the chambers of each cylinder.

    Parameters
    ----------
    robot : Robot
    traces : sequence of Trace
        In order of time within each recording.
    windows : WindowSettings, optional
    extra : callable, optional
        Columns of listed effects.

    Returns
    -------
    HydraulicFit or None
        None where no chamber has pressures, stroke and valve signal.
    """
    windows = windows or WindowSettings()
    again = partial(_gathered, robot, traces, windows, extra)
    return hydraulic_fit(robot, again({}), windows, regather=again)


def _gathered(
    robot: Robot,
    traces: Sequence[Trace],
    windows: WindowSettings,
    extra: ExtraColumns | None,
    rails_off_pa: Mapping[str, float],
) -> list[FlowGatherer]:
    longest_s = windows.max_delay_cycles * max((t.step_s for t in traces), default=0.0)
    gathered: dict[str, FlowGatherer] = {}
    for trace in traces:
        name = trace.recording
        if name not in gathered:
            gathered[name] = FlowGatherer(
                robot, name, windows, extra, longest_s=longest_s, rails_off_pa=rails_off_pa
            )
        gathered[name].add(trace)
    return list(gathered.values())


def hydraulic_fit(
    robot: Robot,
    gathered: Sequence[FlowGatherer],
    windows: WindowSettings,
    solve: Solve = solve_iv,
    regather: Regather | None = None,
) -> HydraulicFit | None:
    """Fit chambers and delay to what was gathered of every recording.

    Parameters
    ----------
    robot : Robot
    gathered : sequence of FlowGatherer
    windows : WindowSettings
    solve : callable
        The estimator.
    regather : callable, optional
        Without it what unread rails are off by is linear, at the robot file's constants.

    Returns
    -------
    HydraulicFit or None
        None where no chamber has enough windows.
    """
    found = fit_delay(robot, gathered, solve)
    if found is None:
        return None
    rails = found.rails
    if regather is not None:
        rails = settled_constants(rails, partial(_linearised, robot, regather, solve))
    by_name = {chamber.channel: chamber for chamber in chambers_of(robot)}
    fitted = [(by_name[name], one) for name, one in found.chambers.items()]
    cylinders = tuple(
        combined([(chamber, one) for chamber, one in fitted if chamber.index == index], rails)
        for index in sorted({chamber.index for chamber, _ in fitted})
    )
    return HydraulicFit(
        found.delay_s,
        found.std_s,
        cylinders,
        windows,
        found.dof,
        found.longest_s,
        found.valves,
        rails,
    )


def _linearised(
    robot: Robot, regather: Regather, solve: Solve, rails_off_pa: Mapping[str, float]
) -> Sequence[RailConstant]:
    found = fit_delay(robot, regather(rails_off_pa), solve)
    if found is None:
        raise IdentError("expected the windows of the first look at the chambers, found fewer")
    return found.rails
