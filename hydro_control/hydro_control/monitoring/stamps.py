"""What stamps say of the clock behind them: gaps between samples, and stamps that went back."""

from __future__ import annotations

from statistics import median

from hydro_control.law.law import GAP_STEPS

#: A motion goes on over this long without a usable sample, s: the longest that a command may
#: drive the valves (the bridge's `max_age_ms`, the amplifiers' watchdog). After more it was ended
#: there, or stamps began anew under another reading of the ROS clock: to go on would be a leap.
LONGEST_GAP_S = 0.05
#: So many spacings tell the rate of samples, by their median: single ones are lost or late.
_SPACINGS = 50
#: Share of the sample time by which they may be apart from a whole number of it.
_OFF = 0.1


class StampWatch:
    """Judges how stamps follow each other.

    Parameters
    ----------
    dt_s : float
        Sample time.

    Attributes
    ----------
    gone_back : str
        How stamps went back by more than a gap, until `forget`; empty where they did not.
    other_rate : str
        How samples come at another rate than the robot file's, until `forget`; empty where they
        do not.
    """

    def __init__(self, dt_s: float) -> None:
        self._dt_s = dt_s
        self._most = max(GAP_STEPS, round(LONGEST_GAP_S / dt_s))
        self.forget()

    def forget(self) -> None:
        """The next stamp is the first."""
        self.gone_back = self.other_rate = ""
        self._spacings: list[float] = []

    def follows(self, apart_s: float) -> None:
        """A sample follows the one before.

        All that the law computes by the sample is wrong where samples come at another rate than
        the robot file says: velocities of a machine of twice its rate are half.

        Parameters
        ----------
        apart_s : float
            Their stamps.
        """
        if len(self._spacings) == _SPACINGS:
            return
        self._spacings.append(apart_s)
        if len(self._spacings) < _SPACINGS:
            return
        usual_s = float(median(self._spacings))
        steps = usual_s / self._dt_s
        if abs(steps - max(1, round(steps))) > _OFF:
            self.other_rate = (
                f"samples are {1e3 * usual_s:.3g} ms apart, expected {1e3 * self._dt_s:.3g} ms"
                " (rate_hz of the robot file): correct one of both, then activate anew"
            )

    def is_gap(self, span_s: float) -> bool:
        """No motion goes on over so long without a sample.

        Parameters
        ----------
        span_s : float
        """
        return round(span_s / self._dt_s) > self._most

    def older(self, by_s: float) -> None:
        """A sample is older than one before: late, or of a clock that began anew.

        Of the latter none may be answered: once stamps had come to where those before were, a
        motion would go on by itself.

        Parameters
        ----------
        by_s : float
            Than the newest, s.
        """
        if self.is_gap(by_s):
            self.gone_back = (
                f"stamps went back by {by_s:.3f} s, expected them to grow (bridge or clock began"
                " anew, or two publish samples): activate the controller anew"
            )
