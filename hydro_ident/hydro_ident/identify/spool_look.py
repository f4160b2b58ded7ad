"""Whether the measured spools of recordings can be taken for the openings of their valves."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from hydro_ident.bag.recorded_run import Recording
from hydro_model.arrays import FloatArray

#: Share of the cycles in which a spool has to be read: flows miss no more than windows here and
#: there. What goes through less than this of its range has not moved.
_WHOLE, _STILL = 0.95, 0.01
#: A reading within so much (rms) of its own command of the same or one of a few cycles before is
#: its echo: with no more than that between them the command tells the same.
_ECHO, _LAGS = 1.0e-3, 4


@dataclass(slots=True)
class SpoolLook:
    """What tells whether the spools of a recording can be taken.

    Attributes
    ----------
    cycles : int
    read, told : (m,) array
        Cycles with a spool's position, and with a voltage.
    span, command_span : (2, m) array
        Least and largest of both, as shares of the full opening.
    squares, pairs : (lags, m) array
        Of what lies between a spool and its command so many cycles before, and of how many.
    """

    cycles: int = 0
    read: FloatArray = field(default_factory=lambda: np.zeros(0))
    told: FloatArray = field(default_factory=lambda: np.zeros(0))
    span: FloatArray = field(default_factory=lambda: np.zeros((2, 0)))
    command_span: FloatArray = field(default_factory=lambda: np.zeros((2, 0)))
    squares: FloatArray = field(default_factory=lambda: np.zeros((_LAGS, 0)))
    pairs: FloatArray = field(default_factory=lambda: np.zeros((_LAGS, 0)))

    def add(self, recording: Recording) -> None:
        """Take in a piece of the recording."""
        rated = np.array([valve.rated_voltage_v for valve in recording.robot.valves])
        count = len(rated)
        if not self.read.size:
            self.read, self.told = np.zeros(count), np.zeros(count)
            nothing = np.repeat([[np.inf], [-np.inf]], count, axis=1)
            self.span, self.command_span = nothing, nothing.copy()
            self.squares, self.pairs = np.zeros((_LAGS, count)), np.zeros((_LAGS, count))
        self.cycles += len(recording)
        missing = np.full((len(recording), count), np.nan)
        spool = missing if recording.spool is None else recording.spool
        command = missing if recording.valve_v is None else recording.valve_v / rated
        command = np.where(np.isfinite(command), np.clip(command, -1.0, 1.0), np.nan)
        self.read += np.isfinite(spool).sum(axis=0)
        self.told += np.isfinite(command).sum(axis=0)
        for values, span in ((spool, self.span), (command, self.command_span)):
            span[0] = np.fmin(span[0], np.fmin.reduce(values, axis=0, initial=np.inf))
            span[1] = np.fmax(span[1], np.fmax.reduce(values, axis=0, initial=-np.inf))
        for lag in range(min(_LAGS, len(recording))):
            apart = spool[lag:] - command[: len(command) - lag]
            self.squares[lag] += np.nansum(apart**2, axis=0)
            self.pairs[lag] += np.isfinite(apart).sum(axis=0)

    def why_not(self, valve: int) -> str:
        """Why the spool of a valve cannot be taken; empty where it can, or need not.

        Parameters
        ----------
        valve : int
            Its index.
        """
        if not self.read.size or not (self.read[valve] or self.told[valve]):
            return ""
        share = float(self.read[valve]) / max(self.cycles, 1)
        if share < _WHOLE:
            return f"was read in {share:.0%} of the cycles"
        moved, asked = (float(s[1, valve] - s[0, valve]) for s in (self.span, self.command_span))
        if moved < _STILL:
            at_rest = bool(self.told[valve]) and asked < _STILL
            return "" if at_rest else f"reads {self.span[0, valve]:.3g} throughout"
        pairs = np.maximum(self.pairs[:, valve], 1.0)
        near = np.sqrt(self.squares[:, valve] / pairs) < _ECHO
        if np.any(near & (self.pairs[:, valve] > 0.0)):
            return "is its command over again"
        return ""
