"""What the frames of the protocol say, decoded."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Frame:
    """A received frame that belongs to the protocol.

    Attributes
    ----------
    name : str
    role : {"sync", "cycle", "command", "claim"}
    alive : int or None
        Alive counter; None where the frame is not protected.
    data : bytes
    intact : bool
        False where length or CRC is wrong: nothing in it may be used.
    """

    name: str
    role: str
    alive: int | None
    data: bytes
    intact: bool


@dataclass(frozen=True, slots=True)
class Status:
    """Status bits of a cycle; bits that the mapping leaves out are False.

    Besides the permissive inputs: `parked` (the device waits to be started), `lockstep` (it
    waits for answers), `amplifier_enabled`, and `amplifier_watchdog` (the amplifiers went to 0
    V by themselves).
    """

    emergency_stop_ok: bool = False
    pump_on: bool = False
    enable_switch: bool = False
    parked: bool = False
    lockstep: bool = False
    amplifier_enabled: bool = False
    amplifier_watchdog: bool = False


@dataclass(frozen=True, slots=True)
class Echo:
    """Valve frames that the amplifiers have heard so far; both counts wrap.

    Attributes
    ----------
    taken : int
        Those that they followed.
    refused : int
        Those that failed their check, or answered a cycle too long past.
    """

    taken: int
    refused: int


@dataclass(frozen=True, slots=True)
class Readings:
    """What the device measured in one cycle, in the order of the codec's names.

    Attributes
    ----------
    counter : int
        Sample counter, 32 bits.
    status : Status
    positions : tuple of float
        Per joint, rad or m (`Codec.joint_names`).
    pressures_pa : tuple of float
        Gauge (`Codec.pressure_names`).
    spools : tuple of float
        Per valve of the robot, NaN where not measured.
    strokes_m : tuple of float
        Per stroke sensor (`Codec.stroke_names`).
    oil_temperature_c : float or None
    echo : Echo or None
        None where the amplifiers do not tell.
    """

    counter: int
    status: Status
    positions: tuple[float, ...]
    pressures_pa: tuple[float, ...]
    spools: tuple[float, ...]
    strokes_m: tuple[float, ...] = ()
    oil_temperature_c: float | None = None
    echo: Echo | None = None


@dataclass(frozen=True, slots=True)
class CommandFrame:
    """A decoded valve command.

    Attributes
    ----------
    answered, answered_bits : int
        Low bits of the answered sample counter, and how many of them.
    voltages : tuple of float
        V, per valve of the robot.
    enable : bool
    """

    answered: int
    answered_bits: int
    voltages: tuple[float, ...]
    enable: bool

    def answers(self, counter: int) -> bool:
        """Whether it answers the cycle with this sample counter."""
        return (counter ^ self.answered) & ((1 << self.answered_bits) - 1) == 0
