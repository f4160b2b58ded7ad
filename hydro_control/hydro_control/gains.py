"""Gains and limits of the control law, with their units."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from pathlib import Path

from hydro_control.errors import ControlError


@dataclass(frozen=True, slots=True)
class Gains:
    """What tunes the law (Table III of the paper names the four k).

    Attributes
    ----------
    k_p_1_s : float
        Position error to required velocity, eq. 19, 1/s.
    k_v : float
        Velocity error of a link to required net force, eq. 20. It multiplies the angular half
        (rad/s to N m, so N m s) and the linear half (m/s to N, so N s/m) of the spatial
        velocity by the same number.
    k_f_m2_ns : float
        Force error to flow term, eq. 23, m^2/(N s) (Table III prints m/(s N)).
    k_x_m : float
        Piston velocity error to flow term, eq. 23, m.
    alpha_q, alpha_qd, alpha_p, alpha_fd : float
        Filter weights of joint position, joint velocity, chamber pressure and the time
        derivative of the required force; 1 is no filter.
    slew_limit_v_s : float
        Greatest change of a valve voltage, V/s.
    """

    k_p_1_s: float = 20.0
    k_v: float = 1.0e4
    k_f_m2_ns: float = 3.0e-8
    k_x_m: float = 0.0
    alpha_q: float = 1.0
    alpha_qd: float = 0.5
    alpha_p: float = 0.5
    alpha_fd: float = 0.5
    slew_limit_v_s: float = 1000.0

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if not math.isfinite(value) or value < 0.0:
                raise ControlError(f"gain {item.name} should be 0 or more, found {value}")
            if item.name.startswith("alpha") and not 0.0 < value <= 1.0:
                raise ControlError(
                    f"filter weight {item.name} should be above 0 and at most 1, found {value}"
                )
        if self.slew_limit_v_s == 0.0:
            raise ControlError("slew_limit_v_s should be above 0 V/s, found 0")


def shipped_gains(name: str = "gains") -> Path:
    """A ROS parameters file of the package.

    Parameters
    ----------
    name : {"gains", "paper_table3"}

    Returns
    -------
    Path

    Raises
    ------
    ControlError
        There is none of that name.
    """
    folder = Path(__file__).parent / "config"
    file = folder / f"{name}.yaml"
    if not file.is_file():
        known = ", ".join(sorted(p.stem for p in folder.glob("*.yaml")))
        raise ControlError(f"no shipped gains '{name}' (known: {known})")
    return file
