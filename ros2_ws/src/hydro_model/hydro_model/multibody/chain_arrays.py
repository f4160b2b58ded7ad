"""The arrays of a robot's chain as the compiled kernels take them, made once per robot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hydro_model.errors import RobotError
from hydro_model.multibody.closed_chain import part_rows
from hydro_model.robot import FloatArray, Robot

_CACHE_SIZE = 64


@dataclass(frozen=True, slots=True, eq=False)
class ChainArrays:
    """Contiguous arrays of a chain of n joints; not to be written to.

    Attributes
    ----------
    rotation : (n, 3, 3) array
    translation_m : (n, 3) array
    axis : (n, 3) array
    prismatic : (n,) bool array
    gravity_m_s2 : (3,) array
    theta : (n, 11) array
        Standard parameters of the links, and the armature of each one's joint.
    parts : (2 k, PART_COLUMNS) array
        Barrels and rods, see `hydro_model.multibody.closed_chain`.
    tip_offset_m : (3,) array
    """

    rotation: FloatArray
    translation_m: FloatArray
    axis: FloatArray
    prismatic: NDArray[np.bool_]
    gravity_m_s2: FloatArray
    theta: FloatArray
    parts: FloatArray
    tip_offset_m: FloatArray

    @property
    def frames(self) -> tuple[FloatArray, FloatArray, FloatArray, NDArray[np.bool_]]:
        """`rotation, translation, axis, prismatic` as the kernels' arguments follow each other."""
        return self.rotation, self.translation_m, self.axis, self.prismatic

    @property
    def bodies(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """`gravity, theta, parts` as the kernels' arguments follow each other."""
        return self.gravity_m_s2, self.theta, self.parts


# A Robot is frozen but neither hashable nor weakly referable: keyed by id, and kept alive by its
# entry so that the id cannot come to mean another robot.
_cache: dict[int, tuple[Robot, ChainArrays]] = {}


def chain_arrays(robot: Robot) -> ChainArrays:
    """The chain's arrays, cached per `Robot` object.

    Parameters
    ----------
    robot : Robot

    Returns
    -------
    ChainArrays
    """
    entry = _cache.get(id(robot))
    if entry is not None:
        return entry[1]
    chain = _build(robot)
    while len(_cache) >= _CACHE_SIZE:
        _cache.pop(next(iter(_cache)), None)
    _cache[id(robot)] = (robot, chain)
    return chain


def _build(robot: Robot) -> ChainArrays:
    joints = robot.joints

    def copied(rows: ArrayLike) -> FloatArray:
        return np.array(rows, dtype=np.float64, order="C")

    return ChainArrays(
        rotation=copied([joint.rotation for joint in joints]),
        translation_m=copied([joint.translation_m for joint in joints]),
        axis=copied([joint.axis for joint in joints]),
        prismatic=np.array([joint.prismatic for joint in joints], dtype=np.bool_),
        gravity_m_s2=copied(robot.gravity_m_s2),
        theta=copied(np.column_stack([robot.link_inertia, [j.armature for j in joints]])),
        parts=part_rows(robot),
        tip_offset_m=copied(robot.tip_offset_m),
    )


def samples(robot: Robot, *vectors: ArrayLike) -> tuple[list[FloatArray], bool]:
    """Joint vectors as stacks of samples.

    Parameters
    ----------
    robot : Robot
    *vectors : (n,) or (N, n) array
        Single vectors beside stacks are repeated.

    Returns
    -------
    list of (N, n) array
        Contiguous and writeable, of whatever kind they were: kernels are compiled for one kind.
    bool
        Whether all were single vectors (then N = 1).

    Raises
    ------
    RobotError
        A shape is neither (n,) nor (N, n), or two stacks differ in length.
    """
    n = robot.dof
    arrays = [np.ascontiguousarray(vector, dtype=np.float64) for vector in vectors]
    for array in arrays:
        if array.ndim not in (1, 2) or array.shape[-1] != n:
            raise RobotError(
                f"robot {robot.name}: expected joint vectors of shape ({n},) or (N, {n}),"
                f" found {array.shape}"
            )
    single = all(array.ndim == 1 for array in arrays)
    if single:
        # Without `np.require`, which takes as long as the tip of a pose does.
        rows = (array.reshape(1, n) for array in arrays)
        return [row if row.flags.writeable else row.copy() for row in rows], True
    lengths = {array.shape[0] for array in arrays if array.ndim == 2}
    if len(lengths) > 1:
        raise RobotError(
            f"robot {robot.name}: expected stacks of equal length, found {sorted(lengths)}"
        )
    shape = (lengths.pop(), n)
    whole = (a if a.shape == shape else np.broadcast_to(a, shape) for a in arrays)
    return [np.require(array, requirements=["C", "W"]) for array in whole], False
