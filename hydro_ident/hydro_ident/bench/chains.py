"""Serial chains without cylinders, as a Robot and as a pinocchio model."""

from __future__ import annotations

from typing import Any

import numpy as np

from hydro_model.multibody.part_regrouping import point_mass
from hydro_model.robot import FloatArray, Joint, Robot

#: Where pinocchio has our standard parameters: it puts Iyy before Ixz.
PINOCCHIO_ORDER = (0, 1, 2, 3, 4, 5, 7, 6, 8, 9)


def chain(dof: int, seed: int = 0) -> Robot:
    """A chain of revolute joints about any axes, with physical links."""
    rng = np.random.default_rng([seed, dof])
    joints = tuple(
        Joint(
            name=f"joint{i}",
            parent_link=f"link{i - 1}",
            child_link=f"link{i}",
            prismatic=False,
            translation_m=rng.normal(size=3) * 0.5,
            rotation=_rotation(rng),
            axis=_rotation(rng)[0],
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
        link_inertia=np.array([_link(rng) for _ in joints]),
        tip_link="tip",
        tip_offset_m=np.zeros(3),
        gravity_m_s2=np.array([0.0, 0.0, -9.81]),
        cylinders=(),
        valves=(),
    )


def pinocchio_model(pin: Any, robot: Robot) -> Any:
    """The same chain for pinocchio, given as the module.

    `pin` is the module.
    """
    model, parent = pin.Model(), 0
    model.gravity.linear = np.array(robot.gravity_m_s2)
    for joint, theta in zip(robot.joints, robot.link_inertia, strict=True):
        place = pin.SE3(np.array(joint.rotation), np.array(joint.translation_m))
        kind = pin.JointModelRevoluteUnaligned(np.array(joint.axis))
        parent = model.addJoint(parent, kind, place, joint.name)
        body = pin.Inertia.FromDynamicParameters(theta[list(PINOCCHIO_ORDER)])
        model.appendBodyToJoint(parent, body, pin.SE3.Identity())
    return model


def _rotation(rng: np.random.Generator) -> FloatArray:
    matrix, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return np.asarray(matrix * np.sign(np.linalg.det(matrix)))


def _link(rng: np.random.Generator) -> FloatArray:
    """Point masses, so that the body is physical."""
    masses, points = rng.uniform(1.0, 5.0, 6), rng.normal(size=(6, 3)) * 0.3
    return np.asarray(masses @ [point_mass(at) for at in points])
