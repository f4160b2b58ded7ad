"""The designed excitation against the paper's parallelogram of equal duration.

    python -m hydro_ident.study.excitation [--duration S] [--seed N] [--truth NAME]

First the prediction: condition numbers and the standard error of every parameter, from the robot
file alone, with the least errors of first moments that rest in poses could give at all. Then
(with --truth) the designed run in the closed loop of rig core and controller
core: how far valves and pressures go, and the errors that a fit of that recording states beside
those predicted for the residuals that it left.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from hydro_control.core.core import ControllerCore, Sample
from hydro_control.gains import Gains
from hydro_hw_bridge.rig.core import RigCore
from hydro_hw_bridge.rig.truth_files import load_truth
from hydro_ident.design.experiment import Design, design_excitation, start_pose
from hydro_ident.design.information import ForceInformation, Residual, moments, sandwich
from hydro_ident.design.limits import Limits, half_range, limit_ratios
from hydro_ident.design.prediction import Motions, Prediction, predict
from hydro_ident.errors import IdentError
from hydro_ident.estimate.forces.inertial import fit_inertial, force_rows
from hydro_ident.estimate.signals.derivatives import FilterSettings
from hydro_ident.estimate.signals.traces import Trace
from hydro_ident.study.gain_choice import gains_of
from hydro_model.command_line.command import Parser, run_command
from hydro_model.hydraulics.cylinder import stroke
from hydro_model.motion.paths import JointPath, load_path
from hydro_model.motion.paths_joints import joint_motion
from hydro_model.multibody.joint_ranges import middle
from hydro_model.robot import FloatArray, Robot
from hydro_model.robot_files import load_robot

#: The shipped gains (`hydro_msgs_docs/gains.md`).
SHIPPED = (3.0e-8, 20.0, 1.0e4, 0.0)
_SETTLE_S = 1.0
_SECOND_NS = 1_000_000_000
#: Of `least_at_rest`: poses per joint, rounds at most, and how near to the least they end.
_GRID, _ROUNDS, _NEAR = 41, 20_000, 0.004


def repeated(robot: Robot, path_name: str, duration_s: float) -> Motions:
    """A closed path driven over and over for a duration, at the sensors' rate.

    `path_name` is that of a shipped path.
    """
    path = load_path(path_name)
    step = 1.0 / robot.sensors.rate_hz
    lap = joint_motion(robot, path, np.arange(0.0, path.duration_s, step))
    count = round(duration_s / step)
    laps = -(-count // len(lap[0]))
    q, qd, qdd = (np.tile(part, (laps, 1))[:count] for part in lap)
    return q, qd, qdd


@dataclass(frozen=True, slots=True)
class Comparison:
    """Two motions of equal duration.

    Attributes
    ----------
    designed, reference : Prediction
    """

    designed: Prediction
    reference: Prediction

    @property
    def gains(self) -> FloatArray:
        """Factor by which every parameter's predicted error is smaller, shape (p,)."""
        pairs = zip(self.reference.parameters, self.designed.parameters, strict=True)
        return np.array([a.std / b.std for a, b in pairs])

    @property
    def mean_gain(self) -> float:
        """Geometric mean of the gains."""
        return float(np.exp(np.log(self.gains).mean()))


def compare(robot: Robot, design: Design, residual: Residual) -> Comparison:
    """A design against the robot's parallelogram."""
    motion = repeated(robot, f"{robot.name}/parallelogram", design.path.duration_s)
    reference = predict(robot, motion, residual, 1.0 / robot.sensors.rate_hz)
    return Comparison(design.prediction, reference)


def least_at_rest(robot: Robot, residual: Residual, duration_s: float) -> dict[str, float]:
    """Least standard errors that first moments could have from rest in poses.

    Each by itself: all of the time is spent in whatever poses within the limits tell most about
    this one parameter, with no way between them and with friction known. A stay T, long against
    the residuals' correlation tau, tells as much as T / (2 tau) independent rows. The shares of
    time are those of the c-optimal design, by the multiplicative algorithm.

    Parameters
    ----------
    robot : Robot
    residual : Residual
    duration_s : float

    Returns
    -------
    dict of str to float
        By base parameter; those that rest says nothing about are left out.
    """
    information = ForceInformation(robot, residual)
    steps = np.linspace(-1.0, 1.0, _GRID)
    grid = np.stack(np.meshgrid(*[steps] * robot.dof, indexing="ij"), axis=-1)
    poses = middle(robot) + half_range(robot) * grid.reshape(-1, robot.dof)
    still = np.zeros_like(poses)
    poses = poses[limit_ratios(robot, Limits(), poses, still, still).max(axis=1) <= 1.0]
    x = information.columns(poses, *np.zeros((2, *poses.shape)))
    felt = np.flatnonzero(np.abs(x).max(axis=(0, 1), initial=0.0) > 0.0)
    each = np.einsum("tkp,tkq->tpq", x[..., felt], x[..., felt])
    size = np.sqrt(np.einsum("tii->i", each) / max(len(each), 1))
    each /= np.outer(size, size)
    rows = duration_s / (2.0 * residual.correlation_s)
    return {
        information.model.names[column]: _least_error(each, k) / (size[k] * float(np.sqrt(rows)))
        for k, column in enumerate(felt)
    }


def _least_error(each: FloatArray, index: int) -> float:
    """Least error of one parameter from a row's worth of poses whose information is `each`."""
    shares = np.full(len(each), 1.0 / len(each))
    for _ in range(_ROUNDS):
        column = np.linalg.inv(np.einsum("t,tpq->pq", shares, each))[:, index]
        gain = np.einsum("p,tpq,q->t", column, each, column) / column[index]
        if gain.max() <= 1.0 + _NEAR:
            break
        shares *= np.sqrt(gain)
        shares /= shares.sum()
    # What any shares could add at most is known: `column[index] / gain.max()` is a lower bound.
    return float(np.sqrt(column[index] / gain.max()))


def drive(robot: Robot, truth: str, path: JointPath, gains: Gains, seed: int) -> Trace:
    """Play a path on the rig's truth plant with the datasheet's controller; what was measured."""
    q0 = joint_motion(robot, path, np.zeros(1))[0][0]
    rig = RigCore(robot, load_truth(truth, robot), seed=seed, q=q0.tolist())
    core = ControllerCore(robot, gains, path, start_delay_s=_SETTLE_S)
    rows = []
    for _ in range(round((path.duration_s + 1.5 * _SETTLE_S) / rig.cycle_s)):
        measurement = rig.readings().measurement
        q, gauge = np.array(measurement.positions), np.array(measurement.pressures_pa)
        chambers = gauge[: 2 * len(robot.cylinders)].reshape(-1, 2)
        absolute = gauge + robot.atmospheric_pressure_pa
        stamp = round(rig.cycles * rig.cycle_s * _SECOND_NS)
        both = absolute[: 2 * len(robot.cylinders)].reshape(-1, 2)
        answer = core.answer(Sample(stamp, q, both[:, 0], both[:, 1], absolute[-2], absolute[-1]))
        if answer is None:
            raise IdentError(
                f"no answer at {stamp} ns: expected a controller core not used before"
            )
        voltage = answer.output.voltage_v
        rows.append((q, chambers[:, 0], chambers[:, 1], gauge[-2], gauge[-1], voltage.copy()))
        rig.actuate(voltage.tolist())
    return _trace(robot, rig.cycle_s, [np.array(c, dtype=float) for c in zip(*rows, strict=True)])


def _trace(robot: Robot, step_s: float, columns: Sequence[FloatArray]) -> Trace:
    q, p_a, p_b, supply, tank, voltage = columns
    rated = {valve.cylinder: (k, valve.rated_voltage_v) for k, valve in enumerate(robot.valves)}
    signals, strokes = np.full(p_a.shape, np.nan), np.zeros(p_a.shape)
    for i, cylinder in enumerate(robot.cylinders):
        strokes[:, i] = stroke(cylinder, q[:, robot.joint_index(cylinder.joint)])
        if cylinder.name in rated:
            k, full = rated[cylinder.name]
            signals[:, i] = np.clip(voltage[:, k] / full, -1.0, 1.0)
    return Trace(
        label="driven#0",
        step_s=step_s,
        time_s=step_s * np.arange(len(q), dtype=np.float64),
        q=q,
        stroke=strokes,
        p_a=p_a,
        p_b=p_b,
        supply=supply,
        tank=tank,
        valve_signal=signals,
        joint_torque=np.full(q.shape, np.nan),
    )


def _run(arguments: Sequence[str]) -> int:
    parser = Parser(prog="excitation", description=__doc__)
    parser.add_argument("--duration", type=float, default=64.0, help="s")
    parser.add_argument(
        "--seed", type=int, default=0, help="of the design and of noise (%(default)s)"
    )
    parser.add_argument("--truth", default="", help="drive the run on this truth of the rig too")
    options = parser.parse_args(arguments)
    robot, residual = load_robot("xs031"), Residual()
    with tempfile.TemporaryDirectory() as folder:
        design = design_excitation(
            robot, start_pose(robot), options.duration, Path(folder), seed=options.seed
        )
    found = compare(robot, design, residual)
    print(f"{design.path.duration_s:.1f} s, seed {options.seed}")
    print("| | parallelogram | designed | gain |")
    print("|---|---|---|---|")
    for name, key in (("condition", "condition"), ("unit columns", "condition_scaled")):
        a, b = getattr(found.reference, key), getattr(found.designed, key)
        print(f"| {name} | {a:.1f} | {b:.1f} | {a / b:.2f} |")
    for a, b, gain in zip(
        found.reference.parameters, found.designed.parameters, found.gains, strict=True
    ):
        print(f"| {a.name}, {a.unit} | {a.std:.3g} | {b.std:.3g} | {gain:.2f} |")
    least = least_at_rest(robot, residual, design.path.duration_s)
    for p in found.reference.parameters:
        if p.name in least:
            gain = p.std / least[p.name]
            print(f"| {p.name}, rest in poses | {p.std:.3g} | {least[p.name]:.3g} | {gain:.2f} |")
    print(f"geometric mean of the gains {found.mean_gain:.2f}, least {found.gains.min():.2f}")
    if options.truth:
        _drive_and_print(robot, options.truth, design, options.seed)
    return 0


def _drive_and_print(robot: Robot, truth: str, design: Design, seed: int) -> None:
    trace = drive(robot, truth, design.path, gains_of(SHIPPED), seed)
    lowest = np.minimum(trace.p_a, trace.p_b).min(axis=0)
    for i, cylinder in enumerate(robot.cylinders):
        signal = float(np.abs(trace.valve_signal[:, i]).max())
        print(
            f"{truth}: {cylinder.name} valve signal up to {signal:.2f},"
            f" pressures from {lowest[i] / 1e6:.2f} MPa"
        )
    for name, stated, predicted in fitted_errors(robot, trace):
        print(f"| {name} | {stated:.3g} | {predicted:.3g} | {stated / predicted:.2f} |")


def fitted_errors(robot: Robot, trace: Trace) -> list[tuple[str, float, float]]:
    """Errors that the fit of a recording states, beside those predicted for its residuals.

    Returns
    -------
    list of (name, stated, predicted)
    """
    information = ForceInformation(robot, Residual())
    found = fit_inertial(information.model, [trace])
    rows = force_rows(information.model, trace, FilterSettings())
    if found is None or rows is None:
        raise IdentError("the driven run is too short to fit")
    left = rows.y - rows.x @ found.fit.theta
    step = float(rows.time_s[1] - rows.time_s[0])
    times = [step * _memory(column) for column in left.T]
    share = float(np.mean(left.std(axis=0) / information.channel_std)) * Residual().force_share
    residual = replace(Residual(), force_share=share, correlation_s=float(np.mean(times)))
    fresh = ForceInformation(robot, residual)
    scaled = rows.x / fresh.channel_std[:, None]
    errors = np.sqrt(np.diag(sandwich(*moments(scaled, step, residual.correlation_s))))
    print(f"residual {share:.4f} of the range, correlated over {residual.correlation_s:.2f} s")
    print("| parameter | stated by the fit | predicted | ratio |")
    return list(zip(information.model.names, found.fit.std.tolist(), errors.tolist(), strict=True))


def _memory(residual: FloatArray) -> float:
    """Rows after which the autocorrelation has fallen to 1 / e."""
    centred = residual - residual.mean()
    power = np.abs(np.fft.rfft(centred, 2 * centred.size)) ** 2
    lags = np.fft.irfft(power)[: centred.size]
    return float(np.flatnonzero(lags < lags[0] / np.e)[0])


def main() -> int:
    """Entry point of `python -m hydro_ident.study.excitation`."""
    return run_command("excitation", _run)


if __name__ == "__main__":
    sys.exit(main())
