"""Joints that move too few times for what is found of them to be a sample."""

from __future__ import annotations

from collections.abc import Sequence

from hydro_ident.mismatch.rows.material import Material
from hydro_ident.mismatch.rows.rests import motions_in, motions_of
from hydro_ident.mismatch.settings import FEW_MOTIONS
from hydro_model.effects.targets import ActiveEffect


class FewMotions:
    """How much more one motion counts for than a block of time, effect by effect.

    What a joint's force shows in one sweep is one curve over its position, whatever the others do
    meanwhile: friction, gravity, levers and sensors' errors are all on it. What passes a valve
    follows its signal, and that is another at every place.

    Parameters
    ----------
    material : Material
    blocks : float
        Of time, in all rows.
    """

    def __init__(self, material: Material, blocks: float) -> None:
        self._robot, most = material.robot, motions_in(material)
        moved = [motions_of(material, j) for j in range(material.robot.dof)]
        # What stands still all along has no curve over its position.
        counted = [m or most for m in moved]
        self._few = [max(blocks / max(m, 1), 1.0) if m < FEW_MOTIONS else 1.0 for m in counted]

    def of(self, terms: Sequence[ActiveEffect]) -> float:
        """Blocks per motion where what effects act on moves too few times; else 1.

        Parameters
        ----------
        terms : sequence of ActiveEffect
            Of what is no force, and of the whole robot, what moves most often tells.
        """
        return max((self._of(term) for term in terms), default=1.0)

    def _of(self, term: ActiveEffect) -> float:
        joint = term.joint
        if term.cylinder is not None:
            joint = self._robot.joint_index(self._robot.cylinders[term.cylinder].joint)
        if joint is None or term.effect.channel != "force":
            return min(self._few, default=1.0)
        return self._few[joint]
