"""Single conditions of the re-checker's core: what each refuses, lets through, or says."""

from __future__ import annotations

import hashlib
import os
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from bench.recheck.small_modules import PROGRAMS

from generators.handover_program import of_walls
from soter.certificate import rechecker, scope
from soter.certificate.case_check import (
    CaseCheck,
    can_fork,
    check_module_claims,
    check_static_claims,
)
from soter.certificate.cell_sets import Grid
from soter.certificate.grid.grid_group import GridCheck, GridGroup
from soter.certificate.grid.group_claims import GroupTables
from soter.certificate.reading import folder as folders
from soter.certificate.reading.case_model import CaseModel
from soter.certificate.reading.folder import FORMAT, canonical_json, read_certificate
from soter.certificate.reading.problem import read_facts
from soter.certificate.report import REJECTED, NotRecheckedError, RejectedError
from soter.certificate.terms.compile_terms import AffineForms
from soter.certificate.terms.linear_enclosures import ZERO, exact, lower, upper
from soter.certificate.terms.terms import Linear, Terms
from soter.language.front_end import check_file, system_to_prove
from unit.certificate import small_proofs
from unit.certificate.test_one_instant import TEXT

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from soter.certificate.reading.module_facts import Facts

    Change = Callable[[Callable[[dict[str, Any]], None]], Path]

arb = type(ZERO)
OTHER = """topic w: float in [-1.0, 1.0];
node Quick period 20ms { subscribes x; publishes w; step { publish w = 1.0; } }
node Calm period 20ms { subscribes x; publishes w; step { publish w = 0.0; } }
rta N { ac Quick; sc Calm; period 20ms; safe x < 3.0; ttf x > 2.0; safer x < 1.0; }
"""
"""A second module, whose mode others may read."""


def facts_of(folder: Path, *pairs: tuple[str, str]) -> Facts:
    """Of the program with two plants, with other texts in some places."""
    text = TEXT
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new)
    path = folder / "two.soter"
    path.write_text(text)
    return small_proofs.facts_of(path, "S", "M")


# ---------------------------------------------------------------- files


def sealed(folder: Path, manifest: dict[str, Any]) -> Path:
    raw = canonical_json(manifest)
    (folder / "manifest.json").write_bytes(raw)
    (folder / "SEAL").write_text(hashlib.sha256(raw).hexdigest() + "\n")
    return folder


@pytest.mark.parametrize("files", [[], None, "files", 1])
def test_files_that_are_no_list_by_name(tmp_path: Path, files: object) -> None:
    with pytest.raises(RejectedError, match="lists no files"):
        read_certificate(sealed(tmp_path, {"schema": FORMAT, "files": files}))


@pytest.mark.parametrize(("given", "word"), [(FORMAT - 1, "older"), (FORMAT + 1, "newer")])
def test_another_format_is_named(tmp_path: Path, given: int, word: str) -> None:
    with pytest.raises(NotRecheckedError, match=word):
        read_certificate(sealed(tmp_path, {"schema": given, "files": {}}))


def test_a_file_that_grows_or_shrinks_is_seen(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"12345")
    assert folders._read_file(tmp_path, "file", 5) == b"12345"
    for size in (4, 6):
        with pytest.raises(RejectedError, match="while it was read"):
            folders._read_file(tmp_path, "file", size)


def test_as_many_cells_as_are_looked_at(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(folders, "CELLS_MAX", 24)
    certificate = folders.Certificate(tmp_path, {}, {}, set())
    for shape in ((3, 4), (12,)):
        certificate.count_cells(shape)
    with pytest.raises(NotRecheckedError, match="more than 24 cells"):
        certificate.count_cells((1,))


@pytest.mark.parametrize("modules", [[], {}, None, {"M": 1}])
def test_a_manifest_without_modules_is_rejected(changed: Change, modules: object) -> None:
    report = rechecker.recheck(changed(lambda manifest: manifest.update(modules=modules)))
    assert (report.verdict, report.reason) == (REJECTED, "the manifest has no modules")


# ---------------------------------------------------------------- claims


DECLARED = (
    "verify { ",
    "verify { late dm 0ms, sc 0ms; response dm 0ms, sc 0ms; acts within 0ms; ",
)
"""With these delays P1c rests on nothing else."""
READS_Y = ("clamp(-x,", "clamp(-x - y,")
"""With this SC reads a topic that the DM does not read."""


@pytest.mark.parametrize("periods", [(1, 1), (5, 1), (1, 5), (6, 1), (1, 6)])
def test_no_controller_is_slower_than_its_dm(tmp_path: Path, periods: tuple[int, int]) -> None:
    facts = facts_of(tmp_path)
    system, module = facts.flying, facts.flying_module
    module.period_ns = 5
    for k, period in zip((module.ac, module.sc), periods, strict=True):
        system.components[k].period_ns = period
    check_module_claims(system, module, {"P1a": "assumed"})
    if max(periods) <= 5:
        check_module_claims(system, module, {"P1a": "proved"})
    else:
        with pytest.raises(RejectedError, match="P1a"):
            check_module_claims(system, module, {"P1a": "proved"})


@pytest.mark.parametrize(
    ("ac", "sc", "outputs", "fine"),
    [
        ("ux", "xu", "ux", True),
        ("u", "ux", "ux", False),
        ("ux", "x", "ux", False),
        ("ux", "ux", "u", False),
        ("", "", "", False),
    ],
)
def test_both_controllers_publish_all_outputs_and_no_others(
    tmp_path: Path, ac: str, sc: str, outputs: str, fine: bool
) -> None:
    facts = facts_of(tmp_path)
    system, module = facts.flying, facts.flying_module
    symbols = {t.name: t.symbol for t in system.topics}
    for k, names in ((module.ac, ac), (module.sc, sc)):
        component = system.components[k]
        assert component.node is not None
        component.node.publishes = tuple(symbols[n] for n in names)
        component.scope.topics |= {t.symbol: t.index for t in system.topics}
    module.outputs = tuple(t.index for n in outputs for t in system.topics if t.name == n)
    check_module_claims(system, module, {"P1b": "assumed"})
    if fine:
        check_module_claims(system, module, {"P1b": "proved"})
    else:
        with pytest.raises(RejectedError, match="P1b"):
            check_module_claims(system, module, {"P1b": "proved"})


def test_what_sc_alone_reads_is_there_within_the_horizon(tmp_path: Path) -> None:
    reads_both = ("ttf abs(x) > 2.0", "ttf abs(x) + abs(y) > 2.0")
    for pairs, blind in (([READS_Y], True), ([READS_Y, reads_both], False), ([], False)):
        facts = facts_of(tmp_path, *pairs)
        horizon = facts.times["H_ns"]
        for start in (horizon - 1, horizon, horizon + 1):
            facts.times["h0_ns"] = start
            if blind and start > horizon:
                with pytest.raises(RejectedError, match="`y`, which the DM does not read"):
                    check_static_claims(facts, {"P1c": "assumed"})
            else:
                check_static_claims(facts, {"P1c": "assumed"})


def test_a_horizon_is_long_enough_from_h_star_on(tmp_path: Path) -> None:
    facts = facts_of(tmp_path)
    least = facts.times["H_star_ns"]
    for horizon in (least, least + 1):
        facts.times["H_ns"] = horizon
        check_static_claims(facts, {"P1c": "assumed"})
    facts.times["H_ns"] = least - 1
    with pytest.raises(RejectedError, match="shorter"):
        check_static_claims(facts, {"P1c": "assumed"})
    check_static_claims(facts, {"P1c": "undecided"})


KEPT_NUMBER = ("state q: float;", "state q: float; state gear: int in [2, 4] = 3;")


def test_a_start_is_asked_with_the_values_with_which_runs_start(tmp_path: Path) -> None:
    """K is empty here: whoever asks finds a start that leaves it."""
    facts = facts_of(tmp_path, KEPT_NUMBER)
    (parameter,) = facts.parameters
    assert (parameter.values, parameter.begins) == ((2, 3, 4), (3, 3))
    tables = GroupTables((0, 1), Grid(((-3.0, 3.0), (-1.0, 1.0))), np.zeros((1, 1), dtype=np.uint8))
    for value in parameter.values:
        model = CaseModel(facts, (value,), ((-3.0, 3.0), (-1.0, 1.0)))
        case = CaseCheck(model, [GridGroup(tables)], {"start"}, {}, 1)
        case.checks = [GridCheck(model, tables, None)]
        if value == 3:
            with pytest.raises(RejectedError, match="an initial state may leave K"):
                case._add_start_tasks()
        else:
            case._add_start_tasks()


@pytest.mark.parametrize("law", [None, "a law"])
def test_each_case_is_held_to_the_law(monkeypatch: pytest.MonkeyPatch, law: str | None) -> None:
    made = []

    def case(*_: object) -> Any:
        made.append(SimpleNamespace(lawful=None, show_claims=lambda: None))
        return made[-1]

    monkeypatch.setattr(rechecker, "CaseModel", lambda *_: None)
    monkeypatch.setattr(rechecker, "narrowed_extents", lambda *_: None)
    monkeypatch.setattr(rechecker, "CaseCheck", case)
    monkeypatch.setattr("soter.certificate.extras.failsafe_law.check_law", lambda of, k, _: (of, k))
    facts: Any = SimpleNamespace(
        parameter_combinations=lambda: iter([(0,), (1,)]), extents=(), left_out=[], turning=set()
    )
    claims: Any = SimpleNamespace(groups=[[], []], law=law, claims=set())
    rechecker._check_cases(facts, claims, {}, 1)
    assert [c.lawful for c in made] == ([None] * 2 if law is None else [(law, 0), (law, 1)])


# ---------------------------------------------------------------- what is said


def test_only_of_a_flow_sensors_are_said_to_be_on_time(tmp_path: Path) -> None:
    (tmp_path / "map.soter").write_text(PROGRAMS["steps"])
    for facts, flow in (
        (facts_of(tmp_path), True),
        (small_proofs.facts_of(tmp_path / "map.soter", "S", "M"), False),
    ):
        said = {a.key for a in scope.assumptions_of(facts)}
        assert ("sensors on time" in said, "one instant" in said) == (flow, not flow)


def test_what_a_view_rests_on_is_said(tmp_path: Path) -> None:
    path = tmp_path / "boxes.soter"
    path.write_text(of_walls())
    checked = check_file(str(path))
    (name,) = checked.systems
    facts = read_facts(system_to_prove(checked, name), "Keep", "left")
    for facts.view in ("left", ""):
        jumps = [a.key for a in scope.assumptions_of(facts) if a.key.startswith("jumps ")]
        assert bool(jumps) is bool(facts.view)


def test_what_is_assumed_of_modes_is_said(tmp_path: Path) -> None:
    for law, said in (("-x", False), ("(mode(N) == Mode.AC ? 0.5 : -x)", True)):
        modules = ("topic u:", f"{OTHER}topic u:"), ("module M;", "module M; module N;")
        facts = facts_of(tmp_path, *modules, ("clamp(-x,", f"clamp({law},"))
        assert ("mode N" in [a.key for a in scope.assumptions_of(facts)]) is said


# ---------------------------------------------------------------- numbers


def test_a_bound_of_a_ball_is_a_bound_and_no_farther_than_it_has_to_be() -> None:
    step = 2.0**-52
    between = exact(1.0) + 3 * exact(step) / 2 + arb(0, 2.0**-100)
    assert lower(between) == 1 + step
    assert upper(exact(1.0) + exact(step) / 2 + arb(0, 2.0**-100)) == 1 + step
    wide = arb(1, 0.25)
    assert 0.75 - 1e-9 < lower(wide) <= wide.lower()
    assert wide.upper() <= upper(wide) < 1.25 + 1e-9


def test_a_factor_that_may_be_zero_turns_the_ends_round() -> None:
    terms = Terms()
    x = terms.add_input("state", "x", exact(1.0), exact(2.0))
    (atom,) = x.terms
    forms = AffineForms(terms, [atom], 1, {})
    for factor, low, high in (
        (arb(-0.5, 0.5), -2.0, 0.0),
        (arb(0.5, 0.5), 0.0, 2.0),
        (exact(-1.0), -2.0, -1.0),
    ):
        forms.bounds = {atom: (exact(1.0), exact(2.0))}  # type: ignore[dict-item]
        ends = forms.term_ends_by_atoms(
            Linear(ZERO, {atom: factor}, ZERO, ZERO, ZERO, nonnegative=False)
        )
        values: list[Any] = [e.content if hasattr(e, "content") else e for e in ends]
        assert values[0].lower() <= low + 1e-9
        assert values[1].upper() >= high - 1e-9


@pytest.mark.skipif(os.name != "posix", reason="processes are forked on POSIX alone")
def test_processes_are_forked_where_there_is_fork() -> None:
    assert can_fork()
