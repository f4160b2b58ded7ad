"""The constants of the diagnosis that several of its parts share, or that decide what is claimed.

Those of one part stand in its module, what `rows` choose by in `rows.choices`. None is tuned on a
single case.
"""

from __future__ import annotations

from dataclasses import dataclass

from hydro_ident.errors import IdentError

#: Chance that anything at all is found on a recording whose model lacks nothing, per question.
#: All candidates, channels, joints and shapes share it.
FAMILY_ERROR = 0.005
#: The same for dependence without a name, which no law speaks for, and for pairs of effects that
#: hide each other: no flip may reach it.
FAMILY_ERROR_UNNAMED = 0.0007
#: Sign flips of whole blocks behind every p-value.
FLIPS = 1999
#: Length of the blocks whose signs are flipped: far beyond what the noise model leaves.
BLOCK_S = 1.0
#: In shorter recordings than so many blocks they are shorter, down to what is still far enough.
LEAST_BLOCKS, SHORTEST_BLOCK_S = 40, 0.25
#: Blocks of equal weight in which a finding shows at least: signs of fewer are never rare.
LEAST_EFFECTIVE = 3.0
#: Folds of the cross-validation, and the length of their blocks.
FOLDS, FOLD_BLOCK_S = 5, 3.0
#: Fewer motions of the joints than this are no sample: what is held out is of the same motions,
#: position, pressures and time run together, and each motion counts as one observation.
FEW_MOTIONS = 4
#: A catalogue law is an idealisation. Two laws whose predictions differ by less than this share
#: (rms) of the effect itself are not told apart by their forms.
FORM_TOLERANCE = 0.05
#: What is left in a channel counts as a further effect only beyond this share (rms) of what the
#: effects found there explain already.
ADDED_SHARE = 0.05
#: What a description of a machine is good for: in none of its channels does a model claim to be
#: better than this share (rms) of what is measured.
PRECISION = 5.0e-5
#: The same of a chamber's mass balance: edges' root law and oil of one stiffness hold no better.
PRECISION_FLOW = 2.5e-4
#: The same where a law acts through the oil's compression alone: no edge's flaw looks like that,
#: and what fittings hold is known in litres (`minor`).
PRECISION_COMPRESSED = 5.0e-5
#: The same for a dependence without a name: no law says that it is more than the form's flaw. And
#: for what wanders with time, or begins at an instant, which no other rows can confirm: sensors
#: drift by as much.
PRECISION_UNNAMED, PRECISION_UNCONFIRMED = 1.0e-3, 1.0e-3
#: A shift in time below this many sampling intervals is no finding: when a sensor is read within
#: its interval is known no better, and noise that a controller feeds back shifts fits by as much.
LEAST_CYCLES = 0.5
#: Of the command's delay one cycle is granted to every machine; so much more is a finding.
LEAST_EXCESS = 0.25
#: A finding, or an unknown dependence, explains at least this share of its channels' residual.
LEAST_SHARE = 0.005
#: The same for what no other recording can confirm.
LEAST_SHARE_UNCONFIRMED = 0.05
#: A channel whose residual is so many times what its sensors' noise leaves, and this share (rms)
#: of what it measures, lacks something, whether or not it follows anything that was recorded.
FAR, FAR_SHARE = 10.0, 0.03
#: So does one of which this share of what varies is left, however noisy its sensors are, unless
#: that is little more than their noise.
GROSS, GROSS_SHARE = 2.5, 0.1
#: A base that is to be kept is another one than its file's from so many stated deviations on.
MOVED = 4.0
#: A name is kept only where it explains at least this share of what any smooth function of the
#: variable it acts through explains.
NAMED_SHARE = 0.7
#: Effects within this much log-likelihood (per unit of overdispersion) of the best are one set.
SET_PROBABILITY = 0.97
#: Most effects that are ever added.
MOST_EFFECTS = 16
#: Effects are searched on no more than this much recording, in evenly spread parts of this length
#: and more; what was found is fitted and verified on more of it.
LONGEST_SCAN_S, PART_S = 80.0, 10.0
#: So much of longer recordings is fitted, and so much verified on, unless more is asked for.
LONGEST_S = 240.0
#: Longest command delay that is looked for, in s.
LONGEST_DELAY_S = 0.012
#: Seed of the sign flips: the same input gives the same result.
SEED = 20240229


@dataclass(frozen=True, slots=True)
class RefineSettings:
    """What an output-error refinement of the effects may cost.

    Attributes
    ----------
    windows : int
        At most so many to fit on, and as many held-out ones to decide on.
    window_s : float
        Their longest length.
    rollouts : int
        At most about so many; there are fewer windows where that asks for it.
    """

    windows: int = 24
    window_s: float = 2.0
    rollouts: int = 2000


@dataclass(frozen=True, slots=True)
class DiagnosisSettings:
    """What may be chosen per run.

    Attributes
    ----------
    fixed_base : bool
        The given base parameters are kept as they are.
    hold_out_every : int
        Without bags to validate on, every so many blocks one is kept for verification.
    refine : RefineSettings or None
        How the effects' parameters are refined by roll-outs; None: they are not.
    longest_s : float
        Of longer recordings so much is fitted, and so much verified on, in evenly spread parts.
    processes : int
        How many fits may go on side by side; the results are the same.

    Raises
    ------
    IdentError
        Less would be fitted than what is searched on, or by no process at all.
    """

    fixed_base: bool = False
    hold_out_every: int = 5
    refine: RefineSettings | None = None
    longest_s: float = LONGEST_S
    processes: int = 1

    def __post_init__(self) -> None:
        if not self.longest_s >= LONGEST_SCAN_S:
            raise IdentError(
                f"expected at least {LONGEST_SCAN_S:g} s of recording to be fitted, found"
                f" {self.longest_s:g}"
            )
        if self.processes < 1:
            raise IdentError(f"expected at least 1 process, found {self.processes}")
