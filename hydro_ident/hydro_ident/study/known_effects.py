"""The controller with effects that are known, not found: which gains, and what each name is worth.

    python -m hydro_ident.study.known_effects [--seeds N N ...]

Every machine is driven along the reference path with its exact base model and the catalogue's
nearest effects, with the machine's own numbers (known) and with friction 30 % and overlap 50 % too
large (wrong). Two tables: neighbours of the shipped gains, and each name left out in turn.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace

from hydro_control.gains import Gains
from hydro_hw_bridge.rig.random_truth import random_truth
from hydro_hw_bridge.rig.truth import Truth
from hydro_ident.recordings.metrics import Tracking
from hydro_ident.study.gain_choice import exact_model, track
from hydro_model.command_line.command import Parser, run_command
from hydro_model.robot import EffectSpec, Robot
from hydro_model.robot_files import load_robot

#: Machines that the shipped gains were chosen on.
DEFAULT_SEEDS = (101, 103)
WRONG_FRICTION, WRONG_OVERLAP = 1.3, 1.5
_TRACK_SEED = 1


def gain_sets() -> dict[str, Gains]:
    """The shipped gains and neighbours."""
    shipped = Gains()
    return {
        "shipped": shipped,
        "k_x = 0.005": replace(shipped, k_x_m=0.005),
        "k_v = 2e4": replace(shipped, k_v=2.0e4),
        "k_p = 30": replace(shipped, k_p_1_s=30.0),
        "k_f = 6e-8": replace(shipped, k_f_m2_ns=6.0e-8),
    }


def known_effects(robot: Robot, truth: Truth, rubbing: float = 1.0, overlap: float = 1.0) -> Robot:
    """A machine's exact base model with the catalogue's nearest effects.

    Parameters
    ----------
    robot : Robot
    truth : Truth
    rubbing, overlap : float
        Factors of Coulomb friction and of the valves' overlap.

    Returns
    -------
    Robot
        Its forms are the catalogue's, not the rig's: friction without bristles, no loss of
        stiffness at low pressure.
    """
    effects: list[EffectSpec] = []
    for c, v in zip(truth.cylinders, truth.valves, strict=True):
        values: dict[str, dict[str, float]] = {
            "coulomb_friction": {"force": rubbing * c.coulomb_friction_n},
            "stribeck_friction": {
                "force": c.static_friction_n - c.coulomb_friction_n,
                "stribeck_velocity": c.stribeck_velocity_m_s,
            },
            "dead_volume": {"volume_a": c.dead_volume_a_m3, "volume_b": c.dead_volume_b_m3},
            "internal_leakage": {"coefficient": c.internal_leakage},
            "valve_deadband": {"width": overlap * v.deadband},
            "valve_null_bias": {"bias": v.null_bias},
            "valve_spool_lag": {"frequency": v.natural_frequency_hz, "damping": v.damping_ratio},
        }
        effects += [EffectSpec(name, c.name, of) for name, of in values.items()]
    delay_s = truth.command_delay_cycles / robot.sensors.rate_hz
    exact = exact_model(robot, truth)
    return replace(exact, effects=tuple(effects), command_delay_s=delay_s)


def _figures(robot: Robot, truth: Truth, model: Robot, gains: Gains) -> str:
    row: Tracking = track(robot, truth, model, gains, _TRACK_SEED)
    excess = row.max_speed_m_s / row.reference_speed_m_s - 1.0
    return f"{row.max_error_mm:.2f} ({excess:+.1%})"


def _gain_table(robot: Robot, seeds: Sequence[int]) -> None:
    print("| machine | gains | base alone | known | wrong |\n|---|---|---|---|---|")
    for seed in seeds:
        truth = random_truth(robot, seed)
        models = (
            exact_model(robot, truth),
            known_effects(robot, truth),
            known_effects(robot, truth, WRONG_FRICTION, WRONG_OVERLAP),
        )
        for name, gains in gain_sets().items():
            used = models if name == "shipped" else models[1:]
            cells = [_figures(robot, truth, model, gains) for model in used]
            cells = cells if name == "shipped" else ["", *cells]
            print(f"| {seed} | {name} | {' | '.join(cells)} |", flush=True)


def _name_table(robot: Robot, seeds: Sequence[int]) -> None:
    print("\n| left out |" + "".join(f" {seed} |" for seed in seeds))
    print("|---|" + "---|" * len(seeds))
    truths = [random_truth(robot, seed) for seed in seeds]
    models = [known_effects(robot, truth) for truth in truths]
    names = ["", *dict.fromkeys(e.name for e in models[0].effects)]
    for name in names:
        cells = [
            _figures(robot, truth, replace(m, effects=_without(m, name)), Gains())
            for truth, m in zip(truths, models, strict=True)
        ]
        print(f"| {name or 'nothing'} | {' | '.join(cells)} |", flush=True)


def _without(robot: Robot, name: str) -> tuple[EffectSpec, ...]:
    return tuple(e for e in robot.effects if e.name != name)


def _run(arguments: Sequence[str]) -> int:
    parser = Parser(prog="known_effects", description=__doc__)
    parser.add_argument(
        "--seeds", type=int, nargs="+", default=list(DEFAULT_SEEDS), help="machines"
    )
    options = parser.parse_args(arguments)
    robot = load_robot("xs031")
    _gain_table(robot, options.seeds)
    _name_table(robot, options.seeds)
    return 0


def main() -> int:
    """Entry point of `python -m hydro_ident.study.known_effects`."""
    return run_command("known_effects", _run)


if __name__ == "__main__":
    sys.exit(main())
