"""Effects that are there and that no machine is without: told in a note, and no finding.

Minutes of a quiet machine tell a transducer's gain to some 0.01 %. That it is 0.05 % off is true
and in its data sheet's tolerance; who is told it as the physics that was left out looks for what
is missing in the wrong place. Such an effect stays in the model, where it keeps others from
taking its part.
"""

from __future__ import annotations

from collections.abc import Sequence

from hydro_ident.mismatch.outcome import Finding
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import Robot

#: Largest sizes that are within what sensors, drawings and seals are good for: the accuracy of a
#: good transducer and of setting a joint's zero, a fitting's oil. Real effects begin at that or
#: well above: gains at 0.1 %, volumes at 0.2 l.
_TOLERATED = {
    "pressure_sensor_gain": ("error", 1.0e-3),
    "pressure_sensor_bias": ("bias", 5.0e3),
    "encoder_offset": ("offset", 5.0e-4),
    "dead_volume": ("volume", 1.0e-5),
}
#: Dry friction of so small a share of what the cylinder can push is that of any seal.
_FRICTION = frozenset({"coulomb_friction", "presliding_friction", "stribeck_friction"})
_FRICTION_SHARE = 2.0e-4


def is_minor(robot: Robot, term: ActiveEffect) -> bool:
    """Whether an effect is no larger than what is tolerated of every machine.

    Parameters
    ----------
    robot : Robot
    term : ActiveEffect
        As fitted.
    """
    name = term.effect.name
    if name in _TOLERATED:
        begin, most = _TOLERATED[name]
        sizes = [abs(v) for n, v in _values(term) if n.startswith(begin)]
        return max(sizes) < most
    if name in _FRICTION and term.cylinder is not None:
        push = robot.cylinders[term.cylinder].area_a_m2 * robot.supply_pressure_pa
        return max(abs(v) for n, v in _values(term) if n == "force") < _FRICTION_SHARE * push
    return False


def parted(robot: Robot, findings: Sequence[Finding]) -> tuple[list[Finding], list[Finding]]:
    """Findings, and those that are minor.

    Parameters
    ----------
    robot : Robot
    findings : sequence of Finding

    Returns
    -------
    findings, minor : list of Finding
    """
    minor = [f for f in findings if is_minor(robot, f.named.term)]
    return [f for f in findings if f not in minor], minor


def minor_notes(minor: Sequence[Finding]) -> list[str]:
    """What they are, in words.

    Parameters
    ----------
    minor : sequence of Finding
    """
    notes = []
    for finding in minor:
        term = finding.named.term
        units = {p.name: "" if p.unit == "1" else f" {p.unit}" for p in term.effect.parameters}
        sizes = [term.effect.parameters[i].name for i in term.effect.sizes]
        told = ", ".join(f"{n} {v:.3g}{units[n]}" for n, v in _values(term) if n in sizes)
        notes.append(
            f"{term.effect.name} of {term.target} is there, but no larger than every machine has"
            f" ({told}): in the model, no finding"
        )
    return notes


def _values(term: ActiveEffect) -> list[tuple[str, float]]:
    names = [p.name for p in term.effect.parameters]
    return [(n, float(v)) for n, v in zip(names, term.parameters, strict=True)]
