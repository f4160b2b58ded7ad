"""Random serial chains, a slider and a copied crane, shared by the tests of this package."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from hydro_model.multibody.part_regrouping import point_mass
from hydro_model.robot import Cylinder, EffectSpec, FloatArray, Joint, Robot, Valve
from hydro_model.robot_files import shipped_robots

MakeChain = Callable[..., Robot]
MakeSlider = Callable[..., Robot]


def _rotation(rng: np.random.Generator) -> FloatArray:
    matrix, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return np.asarray(matrix * np.sign(np.linalg.det(matrix)))


def _unit(rng: np.random.Generator) -> FloatArray:
    vector = rng.normal(size=3)
    return np.asarray(vector / np.linalg.norm(vector))


def _body(rng: np.random.Generator) -> FloatArray:
    """A physical body: positive masses at points, so that its pseudo-inertia is positive."""
    masses, points = rng.uniform(0.5, 5.0, 6), rng.normal(size=(6, 3)) * 0.4
    return np.asarray(masses @ [point_mass(at) for at in points])


def _chain(seed: int, dof: int, prismatic_share: float = 0.3) -> Robot:
    rng = np.random.default_rng([seed, dof])
    joints = tuple(
        Joint(
            name=f"joint{i}",
            parent_link=f"link{i - 1}",
            child_link=f"link{i}",
            prismatic=bool(rng.random() < prismatic_share),
            translation_m=rng.normal(size=3) * 0.6,
            rotation=_rotation(rng),
            axis=_unit(rng),
            lower=-3.0,
            upper=3.0,
            velocity_limit=1.0,
            effort_limit=1.0,
        )
        for i in range(dof)
    )
    return Robot(
        name=f"chain{dof}",
        joints=joints,
        link_inertia=np.array([_body(rng) for _ in joints]),
        tip_link="tip",
        tip_offset_m=rng.normal(size=3) * 0.5,
        gravity_m_s2=9.81 * _unit(rng),
        cylinders=(),
        valves=(),
    )


@pytest.fixture(scope="session")
def make_chain() -> MakeChain:
    """Factory of random chains: `make_chain(seed, dof, prismatic_share=0.3)`."""
    return _chain


def _slider(
    mass_kg: float = 1000.0,
    gravity: float = 0.0,
    viscous_friction: float = 0.0,
    command_delay_s: float = 0.0,
    effects: dict[str, dict[str, float]] | None = None,
) -> Robot:
    """A mass on a cylinder along x, whose closed forms are known; gravity pulls it back."""
    theta = np.zeros((1, 10))
    theta[0, 0] = mass_kg
    joint = Joint(
        name="slide",
        parent_link="base",
        child_link="sled",
        prismatic=True,
        translation_m=np.zeros(3),
        rotation=np.eye(3),
        axis=np.array([1.0, 0.0, 0.0]),
        lower=0.01,
        upper=0.59,
        velocity_limit=1.0,
        effort_limit=1e5,
    )
    cylinder = Cylinder(
        name="ram",
        joint="slide",
        bore_m=0.080,
        rod_m=0.045,
        stroke_m=0.6,
        l1_m=0.0,
        l2_m=0.0,
        q0_rad=0.0,
        x0_m=0.0,
        child_pin_angle_rad=0.0,
        barrel=None,
        rod=None,
        bulk_modulus_pa=1.2e9,
        viscous_friction=viscous_friction,
    )
    valve = Valve("spool", "ram", 10.0, c_pa=9e-7, c_at=8e-7, c_pb=7e-7, c_bt=6e-7)
    return Robot(
        name="slider",
        joints=(joint,),
        link_inertia=theta,
        tip_link="sled",
        tip_offset_m=np.zeros(3),
        gravity_m_s2=np.array([-gravity, 0.0, 0.0]),
        cylinders=(cylinder,),
        valves=(valve,),
        supply_pressure_pa=19e6,
        tank_pressure_pa=1e6,
        command_delay_s=command_delay_s,
        effects=tuple(
            EffectSpec(name, "slider", values) for name, values in (effects or {}).items()
        ),
    )


@pytest.fixture(scope="session")
def make_slider() -> MakeSlider:
    """Factory of sliders: mass, gravity, viscous friction, delay, effects by name."""
    return _slider


@pytest.fixture
def crane(tmp_path: Path) -> Path:
    """A copy of the shipped crane that a test may spoil."""
    source = shipped_robots()["xs031"]
    for name in (source.name, "xs031.urdf"):
        shutil.copy(source.parent / name, tmp_path / name)
    return tmp_path / source.name
