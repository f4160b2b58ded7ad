"""Dependences without a name as a report draws them: as large as what is left, not larger."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from hydro_ident.commands.diagnose import summary_text
from hydro_ident.identify.results import Provenance
from hydro_ident.mismatch.answer.diagnosis import diagnose
from hydro_ident.mismatch.answer.diagnosis_file import as_modelled, finding_dict, result_json
from hydro_ident.mismatch.answer.not_testable import NotTestable
from hydro_ident.mismatch.answer.outcome import NO_IMPROVEMENT, UNKNOWN, Diagnosis
from hydro_ident.mismatch.locating.dependence import Dependence
from hydro_ident.mismatch.locating.locate import dependences
from hydro_ident.mismatch.split import residuals
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_ident.mismatch.unnamed.unknown import Unexplained
from hydro_ident.report.diagnosis_report import report_html
from hydro_ident.report.diagnosis_verdict import diagnosis_verdict
from hydro_ident.report.diagnosis_views import law_views
from hydro_ident.report.law_section import LawView, law_section
from hydro_ident.report.model_parameters import finding_rows
from hydro_ident.report.page import number
from hydro_ident.report.parameter_section import ParameterRow, beside_bound
from hydro_model.robot import EffectSpec, FloatArray, Robot
from hydro_model.robot_files import load_robot

pytestmark = pytest.mark.needs("plotly")

#: Name, length in s and seed of two runs of a machine.
RUNS = (("train", 26.0, 0), ("check", 12.0, 3))
DEADBAND = EffectSpec("valve_deadband", "tilt_valve", {"width": 0.02})


@pytest.fixture(scope="module")
def sticking(
    make_run: tuple[Callable[..., Robot], Callable[..., object]], lay_out: Callable[..., Residuals]
) -> Residuals:
    """A machine whose tilt valve has a dead zone that its model does not have."""
    true_crane, simulated_run = make_run
    return lay_out(simulated_run(replace(true_crane(), effects=(DEADBAND,)), 24.0))


@pytest.fixture(scope="module")
def located(sticking: Residuals) -> list[Dependence]:
    return dependences(sticking.training, sticking.base)


def drawn(work: Residuals, found: Sequence[Dependence]) -> list[LawView]:
    """Dependences as the report of a diagnosis that found no names draws them."""
    names = work.training.predictor.material.channels
    unknown = tuple(
        Unexplained(names[d.channel], (d.variable,), d.share, d.p_value, "", d) for d in found
    )
    return law_views(
        Diagnosis(UNKNOWN, work.robot, None, unexplained=unknown, work=work, whole=work.base)
    )


def rms(values: FloatArray | None) -> float:
    assert values is not None
    return float(np.sqrt(np.mean(values**2)))


def test_a_drawn_law_has_the_size_and_the_share_that_its_text_says(
    sticking: Residuals, located: list[Dependence]
) -> None:
    assert {"direction", "valve_signal", ""} <= {d.times for d in located}
    assert any(d.period for d in located)
    for d, view in zip(located, drawn(sticking, located), strict=True):
        # Lines are fitted to rows that are weighed alike, and drawn by the channel's own weights.
        within = 1e-2 if d.period else 1e-9
        assert rms(view.law) == pytest.approx(d.size, rel=within), view.title
        assert rms(view.law) < 1.1 * rms(view.residual), view.title
        if d.share > 0.0:
            left = 1.0 - (rms(view.left) / rms(view.residual)) ** 2
            assert left == pytest.approx(d.share, abs=within), view.title


def legend(view: LawView) -> list[str]:
    """Names of the lines that are drawn through a view's points."""
    html = law_section([view], "", (view.joint,)).body
    return re.findall(r'"name":"([^"]+)"', html)


def test_what_has_no_name_is_called_no_law(sticking: Residuals, located: list[Dependence]) -> None:
    nothing = Diagnosis(NO_IMPROVEMENT, sticking.robot, None, work=sticking, whole=sticking.base)
    views = [*drawn(sticking, located[:1]), *law_views(replace(nothing, located=tuple(located)))]
    assert len(views) > 1
    for view in views:
        assert "fitted curve" in legend(view)
        assert "law" not in legend(view)


def test_what_the_base_swallows_of_a_law_is_not_drawn(
    sticking: Residuals, located: list[Dependence]
) -> None:
    """The edges' flows and the compression are a chamber's rate of volume."""
    d = next(
        one
        for one in located
        if (one.variable, one.times, one.period) == ("piston_velocity", "", 0.0)
        and sticking.training.predictor.material.is_flow(one.channel)
    )
    (alone,) = drawn(sticking, [d])
    large = 20.0 * rms(alone.residual) / rms(alone.x)
    (more,) = drawn(sticking, [replace(d, coefficients=d.coefficients + large * d.knots)])
    assert rms(more.law) < 1.1 * rms(more.residual)
    assert more.law == pytest.approx(alone.law, abs=1e-2 * rms(alone.law))


@pytest.fixture(scope="module")
def bristling(make_run: tuple[Callable[..., Robot], Callable[..., object]]) -> Diagnosis:
    """Friction whose bristles bend so little that it bears Coulomb's name.

    Long recordings are searched in parts: of fewer rows than are fitted in the end.
    """
    true_crane, simulated_run = make_run
    bristle = EffectSpec("presliding_friction", "lift_cylinder", {"force": 3e3, "distance": 4e-5})
    truth = replace(true_crane(), effects=(bristle,))
    bags = [simulated_run(truth, seconds, seed=s).recording(n) for n, seconds, s in RUNS]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(residuals, "LONGEST_SCAN_S", 13.0)
        return diagnose(load_robot("xs031"), bags[:1], bags[1:])


@pytest.mark.thorough
def test_a_law_that_bears_another_ones_name_is_told_as_what_the_model_has(
    bristling: Diagnosis,
) -> None:
    (one,) = bristling.findings
    assert (one.named.names[0], one.named.term.effect.name) == (
        "coulomb_friction", "presliding_friction",
    )  # fmt: skip
    cards = dict(diagnosis_verdict(bristling, []).cards)
    (left_out,) = cards["What was left out"]
    assert re.fullmatch(
        r"lift cylinder: Coulomb friction( or presliding friction)? \(force \S+ N\), modelled as"
        r" presliding friction\.", left_out,
    )  # fmt: skip
    assert "), modelled as presliding_friction, in lift/force" in summary_text(bristling)
    page = report_html(bristling, Provenance("diagnose", "1", "r", {}, {}).as_dict())
    assert "<td>law in model.yaml</td><td>presliding friction</td>" in re.sub(
        " class=.text.|<wbr>", "", page
    )
    assert bristling.robot is not None
    (written,) = bristling.robot.effects
    rows = finding_rows(bristling, one, {})
    assert {row.name: row.value for row in rows} == {
        f"presliding friction: {name}": pytest.approx(value, rel=1e-12)
        for name, value in written.parameters.items()
    }
    assert all("in the model for what is named Coulomb friction" in row.below for row in rows)


@pytest.mark.thorough
def test_a_law_of_the_model_is_not_among_what_could_not_have_shown(bristling: Diagnosis) -> None:
    names = ("presliding_friction", "backlash", "supply_droop")
    missed = tuple(NotTestable(name, "nothing changes with it") for name in names)
    listed = replace(bristling.given, effects=(EffectSpec("backlash", "tilt", {"width": 1e-3}),))
    said = replace(bristling, not_testable=missed, given=listed)
    sure = " ".join(dict(diagnosis_verdict(said, []).cards)["How sure"])
    assert "Could not have shown in these recordings: supply droop." in sure
    page = report_html(said, Provenance("diagnose", "1", "r", {}, {}).as_dict())
    table = page.partition("could not have shown</h3>")[2].partition("</table>")[0]
    assert len(re.findall("<tr>", table)) == 2
    only = replace(said, not_testable=missed[:1])
    assert "could not have shown" not in report_html(
        only, Provenance("diagnose", "1", "r", {}, {}).as_dict()
    )
    assert "To test what could not show" not in " ".join(
        dict(diagnosis_verdict(only, []).cards)["What to do next"]
    )


def test_a_number_of_the_model_that_is_at_its_bound_is_said_to_be_in_it() -> None:
    loose = ParameterRow("x: force", 10.0, (-5.0, 25.0), "N", None, "", False, "lift")
    name = "lift_cylinder.coulomb_friction.force"
    assert "the value found is in the model" in beside_bound(loose, name).below


@pytest.mark.thorough
def test_no_probability_of_a_finding_is_above_one(bristling: Diagnosis) -> None:
    """A name alone had 1.0000000000000002, its share of its own sum."""
    one = bristling.findings[0]
    above = replace(one, named=replace(one.named, probability=(float(np.nextafter(1.0, 2.0)),)))
    assert finding_dict(bristling, above)["probability"] == [1.0]


@pytest.mark.thorough
def test_held_out_errors_of_a_finding_say_of_what_they_are(bristling: Diagnosis) -> None:
    page = report_html(bristling, Provenance("diagnose", "1", "r", {}, {}).as_dict())
    (one,) = bristling.findings
    before, after = (
        side["lift/force"] for side in (one.verification.before, one.verification.after)
    )
    said = re.sub("<[^>]+>", "|", page)
    assert "held-out error in motion, with every other finding in the model" in said
    assert f"{number(before)} N without it, {number(after)} N with it" in said
    lines = summary_text(bristling).splitlines()
    (own,) = [line for line in lines if "held-out RMSE in motion" in line]
    assert own.endswith(f"{before:.4g} -> {after:.4g} N with it")
    (head,) = [k for k, line in enumerate(lines) if line.startswith("all held-out rows")]
    assert lines[head + 1].startswith("  lift/force     RMSE")


@pytest.mark.thorough
def test_a_finding_whose_channel_the_held_out_rows_do_not_measure_has_no_held_out_error(
    bristling: Diagnosis,
) -> None:
    (one,) = bristling.findings
    silent = replace(one.verification, before={}, after={})
    unmeasured = replace(bristling, findings=(replace(one, verification=silent),))
    origin = Provenance("diagnose", "1", "r", {}, {})
    (written,) = json.loads(result_json(unmeasured, origin))["findings"]
    assert (written["heldout_rmse_before"], written["heldout_rmse_after"]) == (None, None)
    assert "    the rows to verify on do not measure lift/force" in summary_text(unmeasured)
    said = re.sub("<[^>]+>", "|", report_html(unmeasured, origin.as_dict()))
    assert re.search(r"with every other finding in the model\|+these rows do not measure it", said)


def test_a_name_that_another_law_stands_for_is_drawn_on_the_rows_it_was_weighed_on(
    bristling: Diagnosis,
) -> None:
    found = bristling
    assert found.work is not None
    assert found.work.scan.mask.size < found.work.training.mask.size
    (one,) = found.findings
    other = next(c for c in one.named.tried if c.term.effect.name == "coulomb_friction")
    named = replace(one.named, contenders=(other,), tried=(other,), probability=(1.0,))
    instead = replace(one, named=named)
    assert as_modelled(found, instead)[0] is not found.whole
    (view,) = law_views(replace(found, findings=(instead,)))
    assert view.law is not None
    assert view.left is not None
    assert view.x.shape == view.residual.shape == view.law.shape
    assert "law" in legend(view)
    assert rms(view.left) < 0.3 * rms(view.residual)
