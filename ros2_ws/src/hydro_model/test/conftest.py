"""Random serial chains shared by the tests of this package."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hydro_model.robot import FloatArray, Joint, Robot
from hydro_model.urdf import standard_parameters

MakeChain = Callable[..., Robot]


def _rotation(rng: np.random.Generator) -> FloatArray:
    matrix, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return np.asarray(matrix * np.sign(np.linalg.det(matrix)))


def _unit(rng: np.random.Generator) -> FloatArray:
    vector = rng.normal(size=3)
    return np.asarray(vector / np.linalg.norm(vector))


def _body(rng: np.random.Generator) -> FloatArray:
    """A physical body: positive masses at points, so that its pseudo-inertia is positive."""
    masses, points = rng.uniform(0.5, 5.0, 6), rng.normal(size=(6, 3)) * 0.4
    mass, com = float(masses.sum()), masses @ points / masses.sum()
    arms = points - com
    inertia = np.einsum("k,kab->ab", masses, [a @ a * np.eye(3) - np.outer(a, a) for a in arms])
    return standard_parameters(mass, com, inertia)


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
