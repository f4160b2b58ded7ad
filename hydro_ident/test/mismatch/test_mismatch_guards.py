"""What keeps a diagnosis honest, on simulated machines: its rows, its base, its checks."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import fields, replace
from html import unescape
from typing import Any

import numpy as np
import pytest

from hydro_ident.commands.diagnose import summary_text
from hydro_ident.identify.results import Provenance
from hydro_ident.identify.survey import survey_source
from hydro_ident.identify.verdict import NOT_ENOUGH
from hydro_ident.mismatch.answer.diagnosis import _too_little, diagnose
from hydro_ident.mismatch.answer.diagnosis_file import result_dict
from hydro_ident.mismatch.answer.outcome import Diagnosis
from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.fitting.fitting import fit
from hydro_ident.mismatch.locating.locate import dependences
from hydro_ident.mismatch.naming.named import Named, named_of
from hydro_ident.mismatch.naming.worth import bears, in_reach
from hydro_ident.mismatch.rows.prediction import Predictor
from hydro_ident.mismatch.settings import DiagnosisSettings
from hydro_ident.mismatch.split.residuals import Residuals, residuals
from hydro_ident.mismatch.trials.contender import Contender
from hydro_ident.mismatch.unnamed.describe import form_of, form_text
from hydro_ident.mismatch.unnamed.unknown import unexplained
from hydro_ident.mismatch.verifying.agreement import untold
from hydro_ident.mismatch.verifying.confirm import Confirmer
from hydro_ident.mismatch.verifying.verify import Verification, verify
from hydro_ident.recordings.sources import sources_of
from hydro_ident.report.diagnosis_report import report_html
from hydro_ident.report.page import number, written
from hydro_model.effects.catalogue import resolve
from hydro_model.effects.drives import GEAR_BACKLASH
from hydro_model.effects.targets import ActiveEffect
from hydro_model.hydraulics.cylinder import lever, stroke
from hydro_model.robot import EffectSpec, Robot
from hydro_model.robot_files import load_robot

SECONDS = 18.0
COULOMB = EffectSpec("coulomb_friction", "lift_cylinder", {"force": 2500.0})


def _pushed(run: Any, force: np.ndarray) -> Any:
    """The same motion against another force (N,) on the lift cylinder's piston."""
    p_a = run.p_a.copy()
    p_a[:, 0] += force / run.robot.cylinders[0].area_a_m2
    return replace(run, p_a=p_a)


def _direction(run: Any) -> np.ndarray:
    """Of the lift joint, (N,), turning over within some mrad/s."""
    speed = np.gradient(np.convolve(run.q[:, 0], np.ones(25) / 25.0, "same"), 0.002)
    return np.tanh(speed / 0.01)


def _held_out(run: Any, work: Residuals) -> np.ndarray:
    """Samples of a run that lie in held-out blocks, (N,)."""
    split = work.split
    number = np.floor(np.arange(len(run.q)) * 0.002 / split.block_s["run"]).astype(int)
    return np.asarray(number % split.every == split.every - 1)


@pytest.fixture(scope="module")
def plain(crane_run: object) -> Any:
    """A machine that has the datasheet's structure."""
    return crane_run


@pytest.fixture(scope="module")
def clean(plain: Any, lay_out: Callable[..., Residuals]) -> Residuals:
    return lay_out(plain)


@pytest.fixture(scope="module")
def rubbing(
    make_run: tuple[Callable[..., Robot], Callable[..., object]], lay_out: Callable[..., Residuals]
) -> Residuals:
    """A machine with dry friction in its lift cylinder."""
    true_crane, simulated_run = make_run
    return lay_out(simulated_run(replace(true_crane(), effects=(COULOMB,)), SECONDS))


def _named(work: Residuals, start_n: float = 1500.0) -> tuple[Fitted, Named]:
    """Coulomb friction fitted on the training rows, as a search would hand it on."""
    spec = replace(COULOMB, parameters={"force": start_n})
    one = resolve(replace(load_robot("xs031"), effects=(spec,)))[0]
    whole = fit(work.training, work.base.model.with_term(one))
    gain = work.base.squares - whole.squares
    fitted_ = Contender(whole.model.terms[-1], whole, gain, gain, 4.0)
    return whole, named_of([fitted_], 0.001, 1.0)


def _verified(work: Residuals) -> Verification:
    return verify(work.training, *_named(work), work.check)


def test_a_finding_that_gains_no_more_is_dropped(clean: Residuals) -> None:
    """What was found beside another effect and does nothing without it: named once, now idle."""
    whole, named = _named(clean)
    found = verify(clean.training, whole, named, clean.check, tried=300)
    assert not found.stands
    assert "no longer stands out on the training rows" in found.reason


def test_a_finding_that_gains_stands(rubbing: Residuals) -> None:
    found = verify(rubbing.training, *_named(rubbing), rubbing.check, tried=300)
    assert found.stands, found.reason


def test_a_size_that_a_fit_tells_from_nothing(rubbing: Residuals) -> None:
    whole, named = _named(rubbing)
    assert untold(whole, [named.term]) == ""


def test_a_size_that_may_be_nothing(clean: Residuals) -> None:
    """Nothing rubs there: whatever the fit makes of it, its deviations hold it."""
    whole, named = _named(clean)
    assert re.match(
        r"lift_cylinder\.coulomb_friction\.force is \S+ \+- \S+", untold(whole, [named.term])
    )


# Rows -----------------------------------------------------------------------------------------


def test_what_is_checked_on_took_no_part_in_the_fit(clean: Residuals) -> None:
    """Not a row in common, and none nearer than the filters reach."""
    material, fitted_, check = clean.training.predictor.material, clean.training, clean.check
    assert fitted_.mask.any()
    assert check.mask.any()
    assert not (fitted_.mask & check.mask).any()
    for k in range(len(material.channels)):
        times = [np.unique(material.time_s[m & (material.channel == k)])
                 for m in (fitted_.mask, check.mask)]  # fmt: skip
        after = np.clip(np.searchsorted(*times), 1, times[0].size - 1)
        near = [np.abs(times[1] - times[0][at]).min() for at in (after - 1, after)]
        assert min(near) > 0.9 * clean.split.guard_s


def test_nothing_in_the_held_out_blocks_moves_the_fit(
    plain: Any, clean: Residuals, lay_out: Callable[..., Residuals]
) -> None:
    held = _held_out(plain, clean)
    other = lay_out(_pushed(plain, np.where(held, 3000.0 * _direction(plain), 0.0)))
    old, new = clean.base.model, other.base.model
    assert new.theta == pytest.approx(old.theta, rel=0.05, abs=0.02 * np.abs(old.theta).max())
    for one, same in zip(old.robot.cylinders, new.robot.cylinders, strict=True):
        assert same.bulk_modulus_pa == pytest.approx(one.bulk_modulus_pa, rel=0.02)


def test_what_lacks_the_forces_is_named(plain: Any) -> None:
    """Too little to go on: which recording lacks what forces are told from."""
    none, robot = np.full_like(plain.p_a, np.nan), load_robot("xs031")
    recordings = [plain.recording("whole"), plain.recording("without", p_a=none, p_b=none)]
    surveys = [survey_source(source, robot) for source in sources_of(recordings)]
    assert _too_little(robot, surveys).endswith("no chamber pressures in without")
    assert _too_little(robot, surveys[:1]).endswith("half a minute or more")


def test_what_is_verified_on_does_not_decide_by_what_forces_are_told(plain: Any) -> None:
    """Fitted are torques alone: a recording that knows pressures as well has torques, too."""
    robot, none = load_robot("xs031"), np.full_like(plain.p_a, np.nan)
    force = np.stack(
        [
            (c.area_a_m2 * plain.p_a[:, k] - c.area_b_m2 * plain.p_b[:, k])
            * lever(c, plain.q[:, k])
            for k, c in enumerate(robot.cylinders)
        ],
        axis=1,
    )
    fitted_ = plain.recording("torques", effort=force, p_a=none, p_b=none)
    both = plain.recording("both", effort=force)
    sources, others = sources_of([fitted_]), sources_of([both])
    surveys = [survey_source(source, robot) for source in (*sources, *others)]
    work = residuals(robot, sources, others, surveys, DiagnosisSettings())
    assert work is not None
    for material, mask in (
        (work.training.predictor.material, work.training.mask),
        (work.check.predictor.material, work.check.mask),
    ):
        assert material.forces.torque
        for name in ("lift/torque", "tilt/torque"):
            own = material.channel == material.channels.index(name)
            assert (own & mask).sum() > 100


def test_a_recording_that_cannot_verify_is_the_one_that_is_named(plain: Any) -> None:
    short = plain.recording("short")
    short = replace(short, **{
        f.name: v[:10]
        for f in fields(short)
        if isinstance(v := getattr(short, f.name), np.ndarray) and len(v) == len(short)
    })  # fmt: skip
    found = diagnose(load_robot("xs031"), [plain.recording("whole")], [short])
    assert found.verdict == NOT_ENOUGH
    [problem] = found.problems
    assert problem.startswith("short: expected rows to verify on, found none")


# The base -------------------------------------------------------------------------------------


def test_the_refitted_base_is_the_machines(plain: Any, clean: Residuals) -> None:
    model, truth = clean.base.model, plain.robot
    fitted_ = dict(zip(clean.training.predictor.material.forces.names, model.theta, strict=True))
    for one, true in zip(model.robot.cylinders, truth.cylinders, strict=True):
        friction = fitted_[f"{one.name}.viscous_friction"]
        assert friction == pytest.approx(true.viscous_friction, rel=0.1), one.name
        assert one.bulk_modulus_pa == pytest.approx(true.bulk_modulus_pa, rel=0.05), one.name
    for valve, real in zip(model.robot.valves, truth.valves, strict=True):
        for edge in ("c_pa", "c_at", "c_pb", "c_bt"):
            assert getattr(valve, edge) == pytest.approx(getattr(real, edge), rel=0.02)
    for delay_s in model.delays_s:
        assert delay_s == pytest.approx(truth.command_delay_s, abs=2.0e-4)


def test_a_clean_machine_leaves_the_noise_of_its_sensors(clean: Residuals) -> None:
    material, floors = clean.training.predictor.material, clean.noise_floors()
    for k, name in enumerate(material.channels):
        own = (material.channel == k) & clean.training.mask
        left = float(np.std(clean.base.residual[own]))
        assert 0.5 < left / floors[name] < 2.0, name


def test_a_base_that_has_lost_its_inertia_says_nothing_of_the_noise(clean: Residuals) -> None:
    """What it lacked had made -22 kg m^2 of 412: a twentieth of the noise stood as the floor."""

    def floors(robot: Robot) -> dict[str, float]:
        model = replace(clean.base.model, robot=robot)
        return replace(clean, base=replace(clean.base, model=model)).noise_floors()

    found = clean.base.model.robot
    links = {"link_inertia": -0.05 * found.link_inertia}
    if found.part_inertia is not None:
        links["part_inertia"] = -0.05 * found.part_inertia
    lost, given = floors(replace(found, **links)), floors(clean.robot)
    forces = [name for name in lost if name.endswith("/force")]
    assert [lost[name] for name in forces] == [given[name] for name in forces]


@pytest.mark.parametrize("cylinder", [0, 1])
def test_an_effect_acts_in_the_channel_of_its_own_joint_alone(
    clean: Residuals, cylinder: int
) -> None:
    predictor, model = clean.training.predictor, clean.base.model
    material = predictor.material
    target = model.robot.cylinders[cylinder]
    spec = EffectSpec("coulomb_friction", target.name, {"force": 1000.0})
    one = resolve(replace(model.robot, effects=(spec,)))[0]
    column = predictor.contribution(model, one)
    acting = [n for k, n in enumerate(material.channels) if column[material.channel == k].any()]
    assert acting == [f"{target.joint}/force"]


# Checks ---------------------------------------------------------------------------------------


def test_an_effect_of_the_machine_stands_and_its_placebo_does_not(rubbing: Residuals) -> None:
    found = _verified(rubbing)
    assert found.stands
    assert found.p_value < 0.05
    assert found.placebo < 0.5
    # Exactly none: no shift was another one than the finding, so nothing was tried.
    assert found.placebo != 0.0
    assert found.after["lift/force"] < 0.5 * found.before["lift/force"]


def test_what_held_for_the_training_blocks_alone_does_not_stand(
    plain: Any, clean: Residuals, lay_out: Callable[..., Residuals]
) -> None:
    """Friction that is gone whenever a block is held out: only unseen rows can tell."""
    held = _held_out(plain, clean)
    work = lay_out(_pushed(plain, np.where(held, 0.0, 2500.0 * _direction(plain))))
    whole, named = _named(work)
    assert named.term.parameters[0] == pytest.approx(2500.0, rel=0.2)
    found = verify(work.training, whole, named, work.check)
    assert not found.stands


def test_what_no_law_explains_is_reported(plain: Any, lay_out: Callable[..., Residuals]) -> None:
    """A force that ripples over the stroke, like nothing in the catalogue."""
    cylinder = plain.robot.cylinders[0]
    x = stroke(cylinder, plain.q[:, 0])
    work = lay_out(_pushed(plain, 1500.0 * np.sin(2.0 * np.pi * x / (0.5 * np.ptp(x)))))
    left = dependences(work.training, work.base)
    holds = Confirmer(work.training, work.check, work.base).holds
    found = unexplained(work.training, work.base, left, holds)
    assert "lift/force" in {one.channel for one in found}
    assert not unexplained(work.training, work.base, [], holds)


def test_what_is_left_far_beyond_the_sensors_is_told_whatever_it_follows(
    clean: Residuals,
) -> None:
    left = dependences(clean.training, clean.base)
    holds = Confirmer(clean.training, clean.check, clean.base).holds
    assert not unexplained(clean.training, clean.base, left, holds)
    far = {"lift/force": 37.0}
    (one,) = unexplained(clean.training, clean.base, left, holds, far)
    assert (one.channel, one.depends_on) == ("lift/force", ("everywhere",))
    assert "37 times" in one.text


@pytest.mark.thorough
@pytest.mark.needs("plotly")
def test_what_has_no_name_is_told_as_a_form(
    plain: Any, seen_again: Any, lay_out: Callable[..., Residuals]
) -> None:
    """A ripple over the stroke, and a second recording that confirms it: in every result."""
    x = [stroke(plain.robot.cylinders[0], run.q[:, 0]) for run in (plain, seen_again)]
    period = 0.4 * float(np.ptp(x[0]))
    pushed = [
        _pushed(run, 1500.0 * np.cos(2.0 * np.pi * at / period + 1.0))
        for run, at in zip((plain, seen_again), x, strict=True)
    ]
    work = lay_out(pushed[0], pushed[1:])
    confirmer = Confirmer(work.training, work.check, work.base)
    left = dependences(work.training, work.base)
    found = unexplained(work.training, work.base, left, confirmer.holds)
    one = next(u for u in found if u.channel == "lift/force")
    form = form_of(work.training, work.base, confirmer, one.dependence)
    assert form is not None
    assert (form.name, form.variable) == ("cosine", "piston_position")
    value = {v.name: v for v in form.values}
    assert value["amplitude"].value == pytest.approx(1500.0, rel=0.1)
    assert value["amplitude"].unit == "N"
    assert value["period"].value == pytest.approx(period, rel=0.03)
    said = Diagnosis("unknown", work.robot, None, unexplained=(replace(one, form=form),))
    origin = Provenance("diagnose", "0", "xs031", {}, {})
    entry = result_dict(said, origin)["unexplained"][0]
    assert entry["form"]["text"] == form.text
    assert entry["form"]["share_of_curve"]["held_out"] > 0.8
    page = unescape(report_html(said, origin.as_dict()))
    assert page.count(written(form.text)) == 1
    assert f"amplitude {number(value['amplitude'].value, 3)} ± " in page
    strip = page.partition('id="verdict"')[2].partition("</section>")[0]
    assert f"repeats every {value['period'].value:.3g} m of the lift piston" in strip
    assert "cos(" not in strip
    assert form_text(form) in summary_text(said)
    assert result_dict(replace(said, unexplained=(one,)), origin)["unexplained"][0]["form"] is None


@pytest.fixture(scope="module")
def seen_again(make_run: tuple[Callable[..., Robot], Callable[..., object]]) -> Any:
    """The plain machine on another path."""
    true_crane, simulated_run = make_run
    return simulated_run(true_crane(), SECONDS, seed=3)


def test_what_a_joint_rests_on_most_of_the_time_is_no_contact(
    clean: Residuals, plain: Any
) -> None:
    """A spring does, and whatever else follows the joint's position; a ground may be ploughed."""
    material, angle = clean.training.predictor.material, plain.q[:, 1]
    for share, met in ((0.3, True), (0.7, False)):
        place = float(np.quantile(angle, share))
        stop = {"stiffness": 2.0e4, "height": place, "way": 1.0}
        spec = EffectSpec("external_contact", "tilt_cylinder", stop)
        (term,) = resolve(replace(material.robot, effects=(spec,)))
        one = Contender(term, clean.base, 100.0, 100.0, 4.0)
        assert in_reach(clean.training, clean.base, one) is met
    tip = {"stiffness": 2.0e4, "height": 10.0}
    spec = EffectSpec("external_contact", material.robot.name, tip)
    ground = resolve(replace(material.robot, effects=(spec,)))[0]
    ground = replace(ground, cylinder=None, target=material.robot.name)
    assert in_reach(clean.training, clean.base, replace(one, term=ground))


def test_flanks_that_never_bear_are_no_play(clean: Residuals) -> None:
    """Torques of joints without cylinders, as far as 60 N m."""
    (stretch, *_), torque = clean.training.predictor.material.stretches, 60.0 * np.ones((9, 2))
    loaded = replace(stretch, trace=replace(stretch.trace, joint_torque=torque))
    material = replace(clean.training.predictor.material, stretches=(loaded,))
    training = replace(clean.training, predictor=Predictor(material))
    for flank, bear in ((20.0, True), (290.0, False)):
        term = ActiveEffect(GEAR_BACKLASH, None, np.array([0.1, flank]), joint=1)
        one = Contender(term, clean.base, 100.0, 100.0, 4.0)
        assert bears(training, one) is bear
