"""The list: what is broken, by which change of which source, and which test turns red."""

from __future__ import annotations

from dataclasses import dataclass

_GUARDS = "hydro_ident/test/mismatch/test_mismatch_guards.py"
_CHANCE = "hydro_ident/test/mismatch/test_mismatch_chance.py"
_PREDICTION = "hydro_ident/test/mismatch/test_mismatch_prediction.py"
_STATISTICS = "hydro_ident/test/mismatch/test_mismatch_statistics.py"


@dataclass(frozen=True, slots=True)
class Sabotage:
    """A fault that is put into a copy of the sources.

    Attributes
    ----------
    name : str
    breaks : str
        What is wrong then, in words.
    file : str
        Of the package `hydro_ident`, relative to it.
    text, replacement : str
        The source text, which stands in the file exactly once, and what takes its place.
    test : str
        Node of pytest, from the repository's top, that has to fail.
    """

    name: str
    breaks: str
    file: str
    text: str
    replacement: str
    test: str

    @property
    def module(self) -> str:
        """Import name of the file."""
        return f"hydro_ident.{self.file.removesuffix('.py').replace('/', '.')}"


SABOTAGES = (
    # The signals and columns that everything rests on.
    Sabotage(
        "chambers_swapped",
        "the pressure of chamber A stands for that of B, and the other way round",
        "mismatch/rows/material.py",
        'trace.p_a if chamber.side == "a" else trace.p_b)[:, chamber.index])',
        'trace.p_b if chamber.side == "a" else trace.p_a)[:, chamber.index])',
        f"{_PREDICTION}::test_the_true_model_leaves_noise_alone",
    ),
    Sabotage(
        "velocity_sign",
        "viscous friction pushes the piston along",
        "estimate/forces/force_rows.py",
        "friction[:, at, i] = arm * moved.qd[:, at]",
        "friction[:, at, i] = -arm * moved.qd[:, at]",
        f"{_GUARDS}::test_the_refitted_base_is_the_machines",
    ),
    Sabotage(
        "beta_scaled",
        "oil is half as stiff as the fitted modulus says",
        "mismatch/rows/balance_steps.py",
        "np.stack([np.diff(volume), -squeezed, *now, *by_delay, *by_skew], axis=1)",
        "np.stack([np.diff(volume), -2.0 * squeezed, *now, *by_delay, *by_skew], axis=1)",
        f"{_GUARDS}::test_the_refitted_base_is_the_machines",
    ),
    Sabotage(
        "beta_of_the_other_chamber",
        "oil is compressed in the volume of the opposite chamber",
        "mismatch/rows/contributions.py",
        "return volume, middle(volume) * np.diff(pressure_of(chamber, trace))",
        "return volume, middle(chamber_volumes(chamber.cylinder, trace.stroke[:, chamber.index])"
        "[1 - side]) * np.diff(pressure_of(chamber, trace))",
        f"{_GUARDS}::test_the_refitted_base_is_the_machines",
    ),
    Sabotage(
        "lever_inverted",
        "torques are multiplied by the lever arm where they are divided by it",
        "estimate/forces/force_rows.py",
        "inertial[:, at] /= arm[:, None]",
        "inertial[:, at] *= arm[:, None]",
        f"{_PREDICTION}::test_the_true_model_leaves_noise_alone",
    ),
    Sabotage(
        "lever_of_the_other_joint",
        "lever arms are taken at the other joint's angle",
        "estimate/forces/force_rows.py",
        "arm = lever(cylinder, moved.q[:, at])",
        "arm = lever(cylinder, moved.q[:, -1 - at])",
        f"{_GUARDS}::test_the_refitted_base_is_the_machines",
    ),
    Sabotage(
        "delay_ignored",
        "commands act at once, however late they are",
        "estimate/flows/chambers.py",
        "whole = math.floor(delay_s / step_s + 1e-9)",
        "delay_s, whole = 0.0, 0",
        f"{_GUARDS}::test_the_refitted_base_is_the_machines",
    ),
    Sabotage(
        "wrong_joint",
        "friction of a cylinder is put down to another joint",
        "mismatch/rows/contributions.py",
        "own = {joint_of(material.robot, part): part for part in parts(material.robot, one)}",
        "own = {1 - joint_of(material.robot, part): part for part in parts(material.robot, one)}",
        f"{_GUARDS}::test_an_effect_acts_in_the_channel_of_its_own_joint_alone",
    ),
    Sabotage(
        "leak_sign",
        "an effect's flow leaves the chamber that it enters",
        "mismatch/rows/contributions.py",
        "return middle(one.effect.evaluate(",
        "return -middle(one.effect.evaluate(",
        f"{_PREDICTION}::test_the_true_model_leaves_noise_alone",
    ),
    Sabotage(
        "sensor_error_doubled",
        "a sensor's error is added once more where it is to be taken off",
        "mismatch/rows/corrected.py",
        "seen = term.effect.undone(seen, term.index, term.parameters)",
        "seen = term.effect.undone(seen, term.index, -term.parameters)",
        f"{_PREDICTION}::test_a_sensor_that_is_corrected_reads_the_truth",
    ),
    # Noise.
    Sabotage(
        "noise_floor_stuck",
        "the noise of every channel stays at its least value",
        "mismatch/fitting/whitening.py",
        "stds.append(max(std, float(floor[k])))",
        "stds.append(float(floor[k]))",
        f"{_STATISTICS}::test_the_noise_model_finds_an_autoregression_and_whitens_with_it",
    ),
    Sabotage(
        "sensor_floor_stuck",
        "what the sensors' noise leaves is a number that stands in the source",
        "mismatch/split/residuals.py",
        "return {name: float(floors[name]) for name in material.channels}",
        "return {name: 1.0 for name in material.channels}",
        f"{_GUARDS}::test_a_clean_machine_leaves_the_noise_of_its_sensors",
    ),
    Sabotage(
        "whitening_left_out",
        "rows count as independent whatever they owe to the rows before them",
        "mismatch/fitting/whitening.py",
        "whiten(rows, ends[k], ends[k + 1], phi, float(self.std[k]))",
        "whiten(rows, ends[k], ends[k + 1], 0.0 * phi, float(self.std[k]))",
        f"{_STATISTICS}::test_the_noise_model_finds_an_autoregression_and_whitens_with_it",
    ),
    Sabotage(
        "gaps_bridged",
        "a row behind a gap is taken to follow the one before the gap",
        "mismatch/fitting/whitening.py",
        "linked = (self.linked & before)[mask]",
        "linked = self.linked[mask]",
        f"{_STATISTICS}::test_gaps_are_never_bridged",
    ),
    # Held-out rows.
    Sabotage(
        "search_sees_held_out_rows",
        "effects are searched and fitted on all rows, those of the check with them",
        "mismatch/split/residuals.py",
        "training, base = _refitted(robot, predictor, fit_rows & moving, settings)",
        "training, base = _refitted(robot, predictor, moving, settings)",
        f"{_GUARDS}::test_nothing_in_the_held_out_blocks_moves_the_fit",
    ),
    Sabotage(
        "guard_left_out",
        "rows that the filters share with held-out blocks are fitted",
        "estimate/scoring/scores.py",
        "kept &= ~self._held(rows, -shift) & ~self._held(rows, shift)",
        "kept &= ~self._held(rows, 0.0 * shift)",
        f"{_GUARDS}::test_what_is_checked_on_took_no_part_in_the_fit",
    ),
    Sabotage(
        "verified_on_training_rows",
        "a finding is confirmed on the rows that it was fitted to",
        "mismatch/split/residuals.py",
        "check = held_back(training, check_rows, moving)",
        "check = held_back(training, fit_rows, moving)",
        f"{_GUARDS}::test_what_held_for_the_training_blocks_alone_does_not_stand",
    ),
    Sabotage(
        "folds_peek",
        "the fits of the cross-validation see the rows that they are judged by",
        "mismatch/fitting/bench.py",
        "kept = ~(held | (number[0] == fold) | (number[2] == fold))",
        "kept = np.ones_like(held)",
        f"{_STATISTICS}::test_held_out_errors_come_from_fits_without_the_rows",
    ),
    Sabotage(
        "placebo_unshifted",
        "the placebo is the finding itself",
        "mismatch/naming/placebos.py",
        "np.roll(values[place.rows], round(shift * count))",
        "np.roll(values[place.rows], 0)",
        f"{_GUARDS}::test_an_effect_of_the_machine_stands_and_its_placebo_does_not",
    ),
    # Chance.
    Sabotage(
        "one_candidate_for_all",
        "the best of many candidates is held against what one of them gains by chance",
        "mismatch/trials/chance.py",
        "largest = np.maximum(largest, gains - PER_COEFFICIENT * extra)",
        "largest = gains - PER_COEFFICIENT * extra",
        f"{_CHANCE}::test_the_best_of_many_candidates_is_found_by_chance_as_seldom_as_said",
    ),
    Sabotage(
        "rows_flipped_singly",
        "chance flips the sign of single rows as if they were independent",
        "mismatch/fitting/bench.py",
        "block = layout.blocks(block_s)[self.rows]",
        "block = layout.blocks(1.0e-3 * block_s)[self.rows]",
        f"{_CHANCE}::test_rows_that_hang_together_are_not_taken_for_independent",
    ),
    Sabotage(
        "no_refit",
        "a candidate is credited with what the base would take up in a refit",
        "mismatch/fitting/bench.py",
        "told += self.basis[kept].T @ white",
        "told += 0.0 * (self.basis[kept].T @ white)",
        f"{_STATISTICS}::test_a_column_that_the_base_says_already_gains_nothing",
    ),
    Sabotage(
        "impossible_signs",
        "coefficients of a physically impossible sign are taken",
        "mismatch/trials/scoring.py",
        "better = possible & (worth > have)",
        "better = worth > have",
        f"{_STATISTICS}::test_a_coefficient_of_an_impossible_sign_is_not_used",
    ),
    # The answer.
    Sabotage(
        "set_of_one",
        "the first name is given alone, however alike others predict",
        "mismatch/naming/named.py",
        "count = int(np.searchsorted(np.cumsum(weights), SET_PROBABILITY)) + 1",
        "count = 1",
        f"{_CHANCE}::test_laws_that_predict_alike_come_together",
    ),
    Sabotage(
        "unknown_never_reported",
        "what no law explains is passed over in silence",
        "mismatch/unnamed/unknown.py",
        "return tuple(of[k] for k in both for of in (result, rest) if k in of)",
        "return ()",
        f"{_GUARDS}::test_what_no_law_explains_is_reported",
    ),
)
