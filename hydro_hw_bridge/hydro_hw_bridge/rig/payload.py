"""A load at the tip of the simulated machine, taken up or set down while it moves."""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass

import numpy as np

from hydro_hw_bridge.errors import BridgeError
from hydro_hw_bridge.rig.truth import LinkTruth
from hydro_model.robot import FloatArray


@dataclass(frozen=True, slots=True)
class Payload:
    """What hangs at the tip from an instant on: a point mass, fixed to the last link.

    Attributes
    ----------
    mass_kg : float
        0 sets the load down.
    from_s : float
        Device time since the machine was first driven.
    """

    mass_kg: float
    from_s: float = 0.0

    def __post_init__(self) -> None:
        for name, value in (("mass in kg", self.mass_kg), ("time in s", self.from_s)):
            if not (math.isfinite(value) and value >= 0.0):
                raise BridgeError(f"payload: expected a {name} of 0 or more, found {value:g}")


def payload_argument(text: str) -> Payload:
    """A payload from `KG@S`, for argparse."""
    mass, _, start = text.partition("@")
    try:
        return Payload(float(mass), float(start or 0.0))
    except (ValueError, BridgeError) as error:
        raise argparse.ArgumentTypeError(
            f"expected KG@S, both 0 or more, as 50@6.5; found '{text}'"
        ) from error


def loaded(link: LinkTruth, mass_kg: float, at_m: FloatArray) -> LinkTruth:
    """A link with a point mass fixed to it.

    Both bodies are taken about their common centre of mass c, by ``I = sum(I_k + m_k ((d.d) 1 -
    d d^T))`` with d from c to each body's own.

    Parameters
    ----------
    link : LinkTruth
    mass_kg : float
    at_m : (3,) array
        In the link's frame.

    Returns
    -------
    LinkTruth
        The link itself where the mass is 0.
    """
    if mass_kg == 0.0:
        return link
    mass = link.mass_kg + mass_kg
    com = (link.mass_kg * link.com_m + mass_kg * at_m) / mass
    inertia = np.array(link.inertia_com_kg_m2)
    for part, place in ((link.mass_kg, link.com_m), (mass_kg, at_m)):
        d = place - com
        inertia += part * (d @ d * np.eye(3) - np.outer(d, d))
    return LinkTruth(link.name, mass, com, inertia)
