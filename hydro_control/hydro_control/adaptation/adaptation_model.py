"""What online adaptation knows beforehand: its parameters, their bounds and regressor columns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hydro_control.adaptation.adaptation_settings import AdaptationSettings
from hydro_control.adaptation.bounded_estimator import Prior
from hydro_control.state.axes import Axis
from hydro_model.description.urdf import standard_parameters
from hydro_model.effects import CATALOGUE
from hydro_model.effects.signals import PISTON_VELOCITY, SIGNAL_COUNT
from hydro_model.robot import FloatArray, Robot


def coulomb(xd: FloatArray, scale_m_s: float) -> FloatArray:
    """Coulomb friction per newton of its size, by the catalogue's law.

    `scale_m_s` is the velocity over which it turns round.
    """
    signals = np.zeros((len(xd), SIGNAL_COUNT))
    signals[:, PISTON_VELOCITY] = xd
    return CATALOGUE["coulomb_friction"].evaluate(signals, np.array([1.0, scale_m_s]))


def unit_payload(robot: Robot) -> Robot:
    """The chain with nothing but 1 kg at its tip."""
    inertia = np.zeros_like(robot.link_inertia)
    inertia[-1] = standard_parameters(1.0, robot.tip_offset_m, np.zeros((3, 3)))
    weightless = tuple(replace(c, barrel=None, rod=None) for c in robot.cylinders)
    return replace(
        robot, link_inertia=inertia, part_inertia=None, cylinders=weightless, effects=()
    )


def names_of(axes: tuple[Axis, ...]) -> tuple[str, ...]:
    """Names of what is estimated, with the unit where it is not the SI one of the field."""
    return (
        "payload_kg",
        *(f"{a.cylinder.name}.coulomb_friction_n" for a in axes),
        *(f"{a.cylinder.name}.viscous_friction_change" for a in axes),
        *(f"{a.valve.name}.null_bias" for a in axes),
    )


def force_priors(axes: tuple[Axis, ...], s: AdaptationSettings) -> tuple[Prior, ...]:
    """Payload, Coulomb friction and change of viscous friction of every axis.

    Payload may change fast, friction slowly: that is what tells a load from a seal.

    `s` are the settings.
    """
    n = len(axes)
    # Total viscous friction stays at or above 0.
    least = [max(-s.viscous, -a.cylinder.viscous_friction) for a in axes]
    return (
        Prior(-s.payload_kg, s.payload_kg, 0.0, 0.2 * s.payload_kg, 5.0),
        *[Prior(0.0, s.coulomb_n, 0.0, 0.4 * s.coulomb_n, 50.0)] * n,
        *(Prior(low, s.viscous, 0.0, 0.5 * s.viscous, 300.0) for low in least),
    )


def valve_priors(s: AdaptationSettings) -> tuple[Prior, ...]:
    """Null bias, overlap, and gain error even and odd in the signal, of one valve.

    `s` are the settings.
    """
    return (
        Prior(-s.null_bias, s.null_bias, 0.0, 0.5 * s.null_bias, 2.0e-4),
        Prior(0.0, 0.1, 0.0, 0.01, 1.0e-4),
        Prior(-0.5, 0.5, 0.0, 0.2, 1.0e-2),
        Prior(-0.5, 0.5, 0.0, 0.2, 1.0e-2),
    )
