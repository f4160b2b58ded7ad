"""What is said to be beyond what recordings could have shown."""

from __future__ import annotations

from dataclasses import replace

from hydro_ident.mismatch.answer.answering import Answer
from hydro_ident.mismatch.answer.diagnosis import _testable
from hydro_ident.mismatch.answer.not_testable import not_testable
from hydro_ident.mismatch.answer.outcome import Finding
from hydro_ident.mismatch.naming.name import Search
from hydro_ident.mismatch.naming.named import named_of
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_ident.mismatch.trials.contender import Contender
from hydro_ident.mismatch.trials.exclusion import shut_out
from hydro_ident.mismatch.verifying.verify import Verification
from hydro_model.effects.catalogue import resolve
from hydro_model.robot import EffectSpec
from hydro_model.robot_files import load_robot

RUBS = EffectSpec("coulomb_friction", "lift_cylinder", {"force": 3000.0})
BRISTLES = EffectSpec("presliding_friction", "lift_cylinder", {"force": 3000.0, "distance": 1e-4})
DROOPS = EffectSpec("supply_droop", "xs031", {"resistance": 1e9, "time_constant": 0.1})


def test_what_shuts_another_law_out() -> None:
    assert shut_out("coulomb_friction") == {"presliding_friction", "position_dependent_friction"}
    assert not shut_out("supply_droop")


def test_what_the_file_lists_and_what_was_beaten_could_have_shown(laid_crane: Residuals) -> None:
    """The last scan has neither: one is in the model, the others cannot stand beside what is."""
    work = laid_crane
    rubs, bristles, droops = resolve(
        replace(load_robot("xs031"), effects=(RUBS, BRISTLES, DROOPS))
    )
    base = replace(work.base, model=work.base.model.with_term(droops))
    gains = ((rubs, 900.0), (bristles, 300.0))
    tried = [Contender(term, base, gain, gain, 4.0) for term, gain in gains]
    named = named_of(tried, 0.0005, 1.0)
    assert named.names == ("coulomb_friction",)
    found = Finding(named, Verification(1e-4, {}, {}, 0.0, True, ""), ("lift/force",))
    search = Search(base, base, (named,), ())
    answer = Answer(replace(work, base=base), search, base, (found,), (), (), (), ())
    beyond = {one.name for one in not_testable(work.scan, (), _testable(answer))}
    # Nothing was scanned: all others are.
    assert "backlash" in beyond
    own = {"coulomb_friction", "presliding_friction", "position_dependent_friction"}
    assert not beyond & {*own, "supply_droop"}
