"""Single conditions of the re-checker's core: what each refuses, lets through, or says."""

from __future__ import annotations

import hashlib
import itertools
import os
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from bench.recheck.small_modules import PROGRAMS

from soter.certificate import rechecker, scope
from soter.certificate.case_check import (
    CaseCheck,
    can_fork,
    check_module_claims,
    check_static_claims,
)
from soter.certificate.cell_sets import Cells, Grid
from soter.certificate.grid.grid_group import GridCheck, GridGroup
from soter.certificate.reading import folder as folders
from soter.certificate.reading.folder import FORMAT, canonical_json, read_certificate
from soter.certificate.report import NotRecheckedError, RejectedError
from soter.certificate.terms.compile_terms import AffineForms
from soter.certificate.terms.linear_enclosures import ZERO, exact, lower, upper
from soter.certificate.terms.terms import Linear, Terms
from unit.certificate import small_proofs
from unit.certificate.test_one_instant import TEXT

if TYPE_CHECKING:
    from pathlib import Path

    from soter.certificate.reading.module_facts import Facts

arb = type(ZERO)


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


@pytest.mark.parametrize("modules", [[], {}, None])
def test_a_manifest_without_modules_is_rejected(modules: object) -> None:
    manifest = dict.fromkeys(folders.MANIFEST_KEYS.split(), "") | {"modules": modules}
    certificate: Any = SimpleNamespace(manifest=manifest)
    report: Any = SimpleNamespace(program="")
    with pytest.raises(RejectedError, match="no modules"):
        rechecker._check_certificate(certificate, report, 1)


# ---------------------------------------------------------------- claims


def claimed(
    monkeypatch: pytest.MonkeyPatch,
    p1c: str,
    horizon: int,
    least: int,
    start: int = 0,
    seen: str = "",
    **more: str,
) -> None:
    monkeypatch.setattr("soter.certificate.case_check.check_module_claims", lambda *_: None)
    monkeypatch.setattr("soter.certificate.case_check.p1c_verdict", lambda _: "assumed")
    by_dm, by_sc = ([SimpleNamespace(name=n) for n in names] for names in (seen, "xy"))
    setting = SimpleNamespace(by_dm=by_dm, by_sc=by_sc)
    times = {"H_ns": horizon, "H_star_ns": least}
    facts: Any = SimpleNamespace(
        times=times,
        setting=setting,
        start_ns=start,
        flying=None,
        flying_module=None,
    )
    check_static_claims(facts, {"P1c": p1c, **more})


def controllers(
    ac: str = "u", sc: str = "u", outputs: str = "u", periods: tuple[int, int] = (1, 1)
) -> tuple[Any, Any]:
    """A system and a module of period 5 in it: what its controllers publish, and how often."""
    components = [
        SimpleNamespace(node=object(), writes=[ord(n) for n in names], period_ns=period)
        for names, period in zip((ac, sc), periods, strict=True)
    ]
    symbol, topics = SimpleNamespace(latch=None), [ord(n) for n in outputs]
    module = SimpleNamespace(ac=0, sc=1, period_ns=5, outputs=topics, symbol=symbol)
    return SimpleNamespace(components=components), module


@pytest.mark.parametrize("periods", [(1, 1), (5, 1), (1, 5), (6, 1), (1, 6)])
def test_no_controller_is_slower_than_its_dm(periods: tuple[int, int]) -> None:
    system, module = controllers(periods=periods)
    check_module_claims(system, module, {"P1a": "assumed"})
    if max(periods) <= 5:
        check_module_claims(system, module, {"P1a": "proved"})
    else:
        with pytest.raises(RejectedError, match="P1a"):
            check_module_claims(system, module, {"P1a": "proved"})


@pytest.mark.parametrize(
    ("ac", "sc", "outputs", "fine"),
    [
        ("uv", "vu", "uv", True),
        ("u", "uv", "uv", False),
        ("uv", "v", "uv", False),
        ("uv", "uv", "u", False),
        ("", "", "", False),
    ],
)
def test_both_controllers_publish_all_outputs_and_no_others(
    ac: str, sc: str, outputs: str, fine: bool
) -> None:
    system, module = controllers(ac, sc, outputs)
    check_module_claims(system, module, {"P1b": "assumed"})
    if fine:
        check_module_claims(system, module, {"P1b": "proved"})
    else:
        with pytest.raises(RejectedError, match="P1b"):
            check_module_claims(system, module, {"P1b": "proved"})


def test_what_sc_alone_reads_is_there_within_the_horizon(monkeypatch: pytest.MonkeyPatch) -> None:
    for start, seen in ((5, "x"), (4, ""), (6, "xy")):
        claimed(monkeypatch, "assumed", 5, 5, start=start, seen=seen)
    with pytest.raises(RejectedError, match="`y`, which the DM does not read"):
        claimed(monkeypatch, "assumed", 5, 5, start=6, seen="x")


def test_a_horizon_is_long_enough_from_h_star_on(monkeypatch: pytest.MonkeyPatch) -> None:
    for horizon in (5, 6):
        claimed(monkeypatch, "assumed", horizon, 5)
    with pytest.raises(RejectedError, match="shorter"):
        claimed(monkeypatch, "assumed", 4, 5)
    claimed(monkeypatch, "undecided", 4, 5)
    with pytest.raises(RejectedError, match="P1c"):
        claimed(monkeypatch, "proved", 5, 5)


@pytest.mark.parametrize("lawful", [None, [True, True, False]])
@pytest.mark.parametrize("left", [True, False])
def test_k_holds_no_cell_on_which_safe_is_not_certain(
    left: bool, lawful: list[bool] | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where no run leaves K."""
    monkeypatch.setattr("soter.certificate.grid.grid_group.block_tasks", lambda *_: ["asked"])
    grid = Grid(((0.0, 1.0, 2.0, 3.0),))
    for members, allowed in itertools.product(itertools.product((False, True), repeat=3), repeat=2):
        check: Any = SimpleNamespace(
            grid=grid,
            kernel=Cells(grid, np.array(members)),
            allowed=np.array(allowed),
            lawful=None if lawful is None else Cells(grid, np.array(lawful)),
            chains=None,
            tables=SimpleNamespace(core=None),
            are_never_left=lambda _: not left,
        )
        certain = [
            a and (lawful is None or b) for a, b in zip(allowed, lawful or allowed, strict=True)
        ]
        if all(c or not m for m, c in zip(members, certain, strict=True)):
            asked: list[Any] = list(GridCheck.core_tasks(check))
            assert asked == (["asked"] if left else [])
        else:
            with pytest.raises(RejectedError, match="not certain"):
                GridCheck.core_tasks(check)


@pytest.mark.parametrize(("begins", "asked"), [((2.0, 3.0), True), ((3.0,), False)])
def test_a_start_is_asked_with_the_values_with_which_runs_start(
    begins: tuple[float, ...], asked: bool
) -> None:
    facts = SimpleNamespace(parameters=[SimpleNamespace(begins=begins)], controls=[], start_ns=7)
    starts: list[int] = []
    case: Any = SimpleNamespace(
        model=SimpleNamespace(facts=facts, parameter=(2.0,)),
        checks=[SimpleNamespace(start_tasks=starts.append)],
        _add_tasks=list,
    )
    CaseCheck._add_start_tasks(case)
    assert starts == ([7] if asked else [])


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
        cases=lambda: iter([(0,), (1,)]), extents=(), left_out=[], turning=set()
    )
    claims: Any = SimpleNamespace(groups=[[], []], law=law, claims=set())
    rechecker._check_cases(facts, claims, {}, 1)
    assert [c.lawful for c in made] == ([None] * 2 if law is None else [(law, 0), (law, 1)])


# ---------------------------------------------------------------- what is said


@pytest.mark.parametrize("kept", [None, False, True])
@pytest.mark.parametrize("given", [None, False, True])
def test_ac_never_has_control_where_the_table_gives_it_nowhere(
    kept: bool | None, given: bool | None
) -> None:
    levels = () if kept is None else (np.array([False, kept]),)
    tables = SimpleNamespace(
        given_back=None if given is None else np.array([given, False]), levels=levels
    )
    group: Any = SimpleNamespace(tables=tables)
    says = GridGroup.why_ac_never.fget(group)  # type: ignore[attr-defined]
    assert ("gives it back on no estimate" in says) == (given is False)
    assert ("leaves it in control on no estimate" in says) == (kept is False and given is not False)


def test_states_are_drawn_in_cells_of_k() -> None:
    grid = Grid(((0.0, 1.0, 2.0, 3.0),))
    tables = SimpleNamespace(grid=grid, core=np.array([0, 3, 1]))
    group: Any = SimpleNamespace(tables=tables, states=(0,))
    draws = GridGroup.random_points(group, np.random.default_rng(5))
    values = [next(draws)[0] for _ in range(60)]
    assert all(1.0 <= v <= 3.0 for v in values)
    assert min(values) < 2.0 < max(values)


def test_only_of_a_flow_sensors_are_said_to_be_on_time(tmp_path: Path) -> None:
    (tmp_path / "map.soter").write_text(PROGRAMS["steps"])
    for facts, flow in (
        (facts_of(tmp_path), True),
        (small_proofs.facts_of(tmp_path / "map.soter", "S", "M"), False),
    ):
        said = {a.key for a in scope.assumptions_of(facts)}
        assert ("sensors on time" in said, "one instant" in said) == (flow, not flow)


def test_what_a_view_rests_on_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    facts = facts_of(tmp_path)
    monkeypatch.setattr(
        "soter.certificate.extras.handovers.jump_assumptions", lambda *_: [("key", "text")]
    )
    for view in (None, "a view"):
        facts.view = view  # type: ignore[assignment]
        said = [a.key for a in scope.assumptions_of(facts)]
        assert ("key" in said) == (view is not None)


def test_what_is_assumed_of_modes_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    of = "soter.certificate.extras.sc_locals_and_modes.mode_assumptions"
    monkeypatch.setattr(of, lambda *_: [("key", "text")])
    facts = facts_of(tmp_path)
    for modes in ((), ("a mode",)):
        monkeypatch.setattr(type(facts), "modes", modes)
        assert ("key" in [a.key for a in scope.assumptions_of(facts)]) == bool(modes)


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
        ends = forms.range_by_atoms(
            Linear(ZERO, {atom: factor}, ZERO, ZERO, ZERO, nonnegative=False)
        )
        values: list[Any] = [e.content if hasattr(e, "content") else e for e in ends]
        assert values[0].lower() <= low + 1e-9
        assert values[1].upper() >= high - 1e-9


@pytest.mark.skipif(os.name != "posix", reason="processes are forked on POSIX alone")
def test_processes_are_forked_where_there_is_fork() -> None:
    assert can_fork()
