"""Random machines through the search for physically consistent parameters.

    python -m hydro_ident.study.consistency [--count N] [--seed S]

Per number of joints: machines with exact base parameters (all of which have consistent bodies),
and the same with noise on the base parameters, which often leaves none. Printed: how many were
found consistent, the largest error of a base parameter relative to the largest one, the smallest
eigenvalue of a pseudo-inertia in units of its body, how far the closest consistent base
parameters lie beside how far the true ones do, and the time.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hydro_ident.errors import IdentError
from hydro_ident.estimate.bodies.physical import PhysicalParameters
from hydro_ident.identify.consistent_robot import physical_result
from hydro_model.command_line.command import Parser, run_command
from hydro_model.multibody.base_parameters import base_map
from hydro_model.multibody.part_regrouping import point_mass
from hydro_model.multibody.spatial import axis_rotation
from hydro_model.robot import BaseParameter, FloatArray, Joint, Robot

MOST_JOINTS = 7
#: Deviations of the base parameters, relative to the largest one.
NOISE = (0.0, 1.0e-5, 1.0e-3, 1.0e-2)


@dataclass(frozen=True, slots=True)
class Case:
    """One machine with one noise.

    Attributes
    ----------
    found : PhysicalParameters
    error : float
        Of the bodies' base parameters against those claimed, relative to the largest.
    truth_distance : float
        From the noisy base parameters to the true ones, standard deviations.
    seconds : float
    """

    found: PhysicalParameters
    error: float
    truth_distance: float
    seconds: float


def random_robot(rng: np.random.Generator, dof: int) -> Robot:
    """A spatial chain of revolute and prismatic joints whose links are heavy points.

    Parameters
    ----------
    rng : numpy.random.Generator
    dof : int

    Returns
    -------
    Robot
        Without cylinders.
    """
    joints = tuple(_joint(rng, i) for i in range(dof))
    return Robot(
        name=f"chain{dof}",
        joints=joints,
        link_inertia=np.array([_body(rng) for _ in joints]),
        tip_link="tip",
        tip_offset_m=rng.normal(size=3) * 0.5,
        gravity_m_s2=np.array([0.0, 0.0, -9.81]),
        cylinders=(),
        valves=(),
    )


def _unit(rng: np.random.Generator) -> FloatArray:
    vector = rng.normal(size=3)
    return np.asarray(vector / np.linalg.norm(vector))


def _joint(rng: np.random.Generator, index: int) -> Joint:
    return Joint(
        name=f"joint{index}",
        parent_link=f"link{index - 1}",
        child_link=f"link{index}",
        prismatic=bool(rng.random() < 0.25),
        translation_m=rng.normal(size=3) * 0.6,
        rotation=axis_rotation(_unit(rng), np.asarray(rng.uniform(0.0, np.pi))),
        axis=_unit(rng),
        lower=-3.0,
        upper=3.0,
        velocity_limit=1.0,
        effort_limit=1.0,
    )


def _body(rng: np.random.Generator) -> FloatArray:
    masses, points = rng.uniform(0.5, 5.0, 10), rng.normal(0.2, 0.4, size=(10, 3))
    return np.asarray(masses @ [point_mass(at) for at in points])


def run_case(rng: np.random.Generator, truth: Robot, given: Robot, noise: float) -> Case:
    """Identify a machine's base parameters by fiat and look for bodies that have them.

    Parameters
    ----------
    rng : numpy.random.Generator
    truth : Robot
    given : Robot
        The same chain with other links: the CAD.
    noise : float
        Deviation of each base parameter, relative to the largest.

    Returns
    -------
    Case

    Raises
    ------
    IdentError
        No answer was found.
    """
    base = base_map(truth)
    exact = base.combination @ truth.link_inertia.ravel()
    std = noise * float(np.abs(exact).max())
    draw = rng.normal(size=exact.size)
    rows = tuple(
        BaseParameter(name, base.coefficients(i), float(exact[i] + std * draw[i]))
        for i, name in enumerate(base.names)
    )
    covariance = std**2 * np.eye(exact.size)
    identified = replace(given, base_parameters=rows, base_covariance=covariance)
    begin = time.perf_counter()
    result = physical_result(identified, given)
    seconds = time.perf_counter() - begin
    if result.parameters is None:
        raise IdentError("; ".join(result.problems))
    theta = np.array([v for b in result.parameters.bodies for v in b.parameters.values()])
    error = np.abs(base.combination @ theta - result.parameters.closest).max()
    relative = float(error / np.abs(exact).max())
    return Case(result.parameters, relative, float(np.linalg.norm(draw)), seconds)


def table(count: int, seed: int) -> list[str]:
    """Run the study.

    Parameters
    ----------
    count : int
        Machines per number of joints.
    seed : int

    Returns
    -------
    list of str
        Lines of a table.
    """
    lines = ["joints  noise  consistent  base error  eigenvalue  closest / true  largest time"]
    for dof in range(1, MOST_JOINTS + 1):
        rng = np.random.default_rng([seed, dof])
        pairs = []
        for _ in range(count):
            truth = random_robot(rng, dof)
            other = replace(truth, link_inertia=np.array([_body(rng) for _ in truth.joints]))
            pairs.append((truth, other))
        for noise in NOISE:
            cases = [run_case(rng, truth, other, noise) for truth, other in pairs]
            lines.append(_row(dof, noise, cases))
    return lines


def _row(dof: int, noise: float, cases: Sequence[Case]) -> str:
    good = sum(c.found.feasible for c in cases)
    depth = min(b.depth for c in cases for b in c.found.bodies)
    far = [c.found.distance / c.truth_distance for c in cases if not c.found.feasible]
    closest = f"{np.median(far):.2f}" if far and noise else "-"
    return (
        f"{dof:6d}  {noise:5.0e}  {good:4d} / {len(cases):3d}  {max(c.error for c in cases):10.1e}"
        f"  {depth:10.1e}  {closest:>14}  {max(c.seconds for c in cases):10.2f} s"
    )


def run(arguments: Sequence[str]) -> int:
    """Body of the command; returns its exit code."""
    p = Parser(prog="consistency", description="Consistent parameters of random machines.")
    p.add_argument("--count", type=int, default=20, help="machines per number of joints")
    p.add_argument("--seed", type=int, default=0, help="which machines (%(default)s)")
    options = p.parse_args(arguments)
    if options.count < 1:
        p.error(f"--count: expected 1 or more, found {options.count}")
    print("\n".join(table(options.count, options.seed)))
    return 0


def main() -> int:
    """Entry point."""
    return run_command("consistency", run)


if __name__ == "__main__":
    sys.exit(main())
