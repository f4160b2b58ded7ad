"""What variables are called in a channel's texts, and their units there."""

from __future__ import annotations

from dataclasses import dataclass

from hydro_ident.mismatch.rows.material import Material
from hydro_ident.mismatch.rows.state_space import UNITS
from hydro_model.effects.units import unit_at_joint
from hydro_model.robot import Robot


@dataclass(frozen=True, slots=True)
class ChannelWords:
    """Names and units in a channel; in that of a joint's torque the piston is the joint itself.

    Attributes
    ----------
    robot : Robot
    channel : str
        Its name.
    """

    robot: Robot
    channel: str

    @staticmethod
    def of(material: Material, channel: int) -> ChannelWords:
        """The words of a material's channel."""
        return ChannelWords(material.robot, material.channels[channel])

    @property
    def joint(self) -> str:
        """Name of the joint."""
        return self.channel.split("/")[0]

    @property
    def is_joint(self) -> bool:
        """Whether the joint's torque was measured, no cylinder's force or flow."""
        return self.channel.endswith("/torque")

    @property
    def part(self) -> str:
        """What moves."""
        return "joint" if self.is_joint else "piston"

    @property
    def force(self) -> str:
        """What it pushes with."""
        return "torque" if self.is_joint and not self._prismatic else "force"

    def unit(self, variable: str) -> str:
        """Unit of a variable of `UNITS`."""
        # The other joint may be of another kind.
        own = self.is_joint and variable != "other_joint"
        if own or variable == "joint_angle":
            return unit_at_joint(UNITS[variable], self._prismatic)
        return UNITS[variable]

    def name(self, variable: str) -> str:
        """Name of a variable in a formula; files keep that of `UNITS`."""
        if variable == "joint_angle" and self._prismatic:
            return "joint_position"
        if variable == "piston_force":
            return f"{self.part}_{self.force}"
        return variable.replace("piston", self.part)

    def prose(self, variable: str) -> str:
        """Name of a variable in a sentence."""
        return self.name(variable).replace("_", " ")

    @property
    def _prismatic(self) -> bool:
        return self.robot.joints[self.robot.joint_index(self.joint)].prismatic
