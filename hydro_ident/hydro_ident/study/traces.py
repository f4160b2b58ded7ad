"""What a hidden effect leaves in the balances of a machine that does not have it.

Along a run of the whole machine, its true motion, pressures and their derivatives, as the sensors
would show them without noise, are put into the balances of the plain machine. What is left over is
the effect's trace in every channel, to the last digit: without the effect it is zero.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hydro_hw_bridge.rig.following import (
    Signals,
    Track,
    balance_residuals,
    follow,
    late_commands,
    true_rates,
)
from hydro_hw_bridge.rig.plant import Plant
from hydro_hw_bridge.rig.readings import (
    shown_positions,
    shown_pressures,
    shown_rises,
    true_pressures,
)
from hydro_hw_bridge.rig.truth import Truth
from hydro_ident.study.experiments import Motion, servo_for
from hydro_ident.study.hidden import Machine, Scene
from hydro_model.robot import FloatArray

#: Where the linearisation of a plain machine's numbers is taken, and the trace sampled: 100 Hz.
EVERY = 5


@dataclass(frozen=True, slots=True)
class Drive:
    """A run of a machine along a motion.

    Attributes
    ----------
    machine : Machine
    plant : Plant
        As after the run.
    track : Track
    """

    machine: Machine
    plant: Plant
    track: Track


def drive(machine: Machine, motion: Motion, seed: int) -> Drive:
    """Run a machine along a motion.

    Parameters
    ----------
    machine : Machine
    motion : Motion
    seed : int
        Of the encoders' noise.
    """
    plant = Plant(machine.robot, machine.truth, motion.q[0])
    servo = servo_for(machine.robot)
    track = follow(plant, servo, motion.q, motion.qd, seed=seed, payload=machine.payload)
    return Drive(machine, plant, track)


def scene_of(run: Drive) -> Scene:
    """What a run visits."""
    plant, states = run.plant, run.track.states[::50]
    n, m = run.machine.robot.dof, len(run.machine.robot.cylinders)
    stroke, lever = np.empty((len(states), m)), np.empty((len(states), m))
    height = np.empty(len(states))
    for k, state in enumerate(states):
        plant.state[: 2 * n] = state[: 2 * n]
        height[k] = plant.tip()[2]
        stroke[k] = plant.strokes()
        _, _, lever[k] = plant.equations(state[:n], state[n : 2 * n])
    middle = np.median(states[:, :n], axis=0)
    inertia, _, _ = plant.equations(middle, np.zeros(n))
    pressures = states[:, 2 * n : 2 * n + 2 * m]
    return Scene(
        duration_s=len(run.track.states) * run.track.cycle_s,
        stroke_m=stroke,
        lever=lever,
        pressure_a=pressures[:, :m],
        pressure_b=pressures[:, m:],
        tip_height_m=height,
        inertia=np.diag(inertia).copy(),
    )


def shown_signals(run: Drive, plain: Truth) -> Signals:
    """A run's signals without noise, for the balances of a plain machine.

    Parameters
    ----------
    run : Drive
    plain : Truth
        Gives the delay of the command, and the lines where they are not recorded.
    """
    machine, track = run.machine, run.track
    robot, n, m = machine.robot, machine.robot.dof, len(machine.robot.cylinders)
    fresh = Plant(robot, machine.truth, track.states[0, :n])
    rates = true_rates(fresh, track, machine.payload)
    q, qd, qdd = shown_positions(
        fresh, track.states[:, :n], track.states[:, n : 2 * n], rates[:, n : 2 * n]
    )
    pressures = shown_pressures(fresh, true_pressures(fresh, track.states), track.cycle_s)
    rises = shown_rises(fresh, true_pressures(fresh, rates), track.cycle_s)
    lines = pressures[:, 2 * m :]
    if not machine.lines_recorded:
        known = (plain.supply.pressure_pa, plain.supply.tank_pressure_pa)
        lines = np.tile(known, (len(q), 1))
    delay = plain.command_delay_cycles + plain.extras.machine.command_delay_s / track.cycle_s
    return Signals(
        *(q, qd, qdd),
        *(pressures[:, 0 : 2 * m : 2], pressures[:, 1 : 2 * m : 2]),
        *(rises[:, 0 : 2 * m : 2], rises[:, 1 : 2 * m : 2]),
        lines,
        late_commands(track.commands, delay),
    )


def thinned(values: FloatArray, every: int = EVERY) -> FloatArray:
    """Means of `every` rows after one another, (N // every, ...)."""
    whole = len(values) // every * every
    return np.asarray(values[:whole].reshape(-1, every, *values.shape[1:]).mean(axis=1))


def thinned_signals(signals: Signals, every: int = EVERY) -> Signals:
    """Signals at every so many samples, each the mean over them."""
    names = ("q", "qd", "qdd", "p_a", "p_b", "rise_a", "rise_b", "lines", "asked")
    return Signals(*(thinned(getattr(signals, name), every) for name in names))


def trace(run: Drive, plain: Machine) -> FloatArray:
    """What a run leaves in the balances of the plain machine, (N // EVERY, 3 m)."""
    start = run.track.states[0, : run.machine.robot.dof]
    reference = Plant(plain.robot, plain.truth, start)
    return thinned(balance_residuals(reference, shown_signals(run, plain.truth)))


def nuisance(run: Drive, plain: Machine, *, delay: bool) -> list[FloatArray]:
    """Columns that a refit of the plain machine's numbers can take up, per channel.

    Parameters
    ----------
    run : Drive
    plain : Machine
    delay : bool
        The command's delay is one of the numbers.

    Returns
    -------
    list of (N // EVERY, k) array
        One matrix for all force channels together (rows channel by channel), then one per flow
        channel.
    """
    signals = thinned_signals(shown_signals(run, plain.truth))
    start = run.track.states[0, : plain.robot.dof]

    def left(truth: Truth) -> FloatArray:
        return balance_residuals(Plant(plain.robot, truth, start), signals)

    base = left(plain.truth)
    force = [left(t) - base for t in _force_variants(plain.truth)]
    flow = [left(t) - base for t in _flow_variants(plain.truth)]
    if delay:
        slope = np.gradient(signals.asked, axis=0)
        moved = replace(signals, asked=signals.asked + slope)
        flow.append(balance_residuals(Plant(plain.robot, plain.truth, start), moved) - base)
    m = len(plain.robot.cylinders)
    columns = [_stacked(force, range(0, 3 * m, 3))]
    columns += [_stacked(flow, [c]) for c in range(3 * m) if c % 3]
    return columns


def _stacked(traces: list[FloatArray], channels: range | list[int]) -> FloatArray:
    """Rows channel by channel, one column per trace that is not zero there."""
    rows = [np.concatenate([t[:, c] for c in channels]) for t in traces]
    sizes = [float(np.abs(row).max()) for row in rows]
    kept = [row / size for row, size in zip(rows, sizes, strict=True) if size > 0.0]
    count = len(traces[0]) * len(channels)
    return np.array(kept).T if kept else np.zeros((count, 0))


def _force_variants(truth: Truth) -> list[Truth]:
    """The truth with another mass, place or inertia of a link, or viscous friction, each."""
    out = []
    for i, link in enumerate(truth.links):
        changed = [replace(link, mass_kg=link.mass_kg * 1.1 + 1.0)]
        for a in range(3):
            place = np.array(link.com_m)
            place[a] += 0.1
            changed.append(replace(link, com_m=place))
        for a in range(3):
            for b in range(a + 1):
                inertia = np.array(link.inertia_com_kg_m2)
                inertia[a, b] += 10.0
                inertia[b, a] = inertia[a, b]
                changed.append(replace(link, inertia_com_kg_m2=inertia))
        out += [
            replace(truth, links=(*truth.links[:i], new, *truth.links[i + 1 :])) for new in changed
        ]
    for i, cylinder in enumerate(truth.cylinders):
        thicker = replace(cylinder, viscous_friction=cylinder.viscous_friction + 1.0e4)
        records = (*truth.cylinders[:i], thicker, *truth.cylinders[i + 1 :])
        out.append(replace(truth, cylinders=records))
    return out


def _flow_variants(truth: Truth) -> list[Truth]:
    """The truth with another edge of a valve, or another oil, each."""
    out = []
    for i, valve in enumerate(truth.valves):
        for edge in ("c_pa", "c_at", "c_pb", "c_bt"):
            wider = replace(valve, **{edge: 1.1 * getattr(valve, edge)})
            out.append(replace(truth, valves=(*truth.valves[:i], wider, *truth.valves[i + 1 :])))
    softer = replace(truth.fluid, bulk_modulus_pa=0.9 * truth.fluid.bulk_modulus_pa)
    return [*out, replace(truth, fluid=softer)]
