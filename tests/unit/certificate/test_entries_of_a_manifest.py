"""Each figure of a manifest beside that of the program; what is asked of which group and case."""

from __future__ import annotations

import copy
import itertools
import math
from concurrent.futures import BrokenExecutor
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from soter.certificate import rechecker
from soter.certificate.cell_sets import Grid
from soter.certificate.extras import estimates_and_shield
from soter.certificate.extras.estimates_and_shield import packed_levels
from soter.certificate.extras.left_out_states import GridBeyondEnds, has_no_ends
from soter.certificate.grid.grid_group import GridGroup
from soter.certificate.grid.group_claims import GroupTables
from soter.certificate.proof_methods import MODULES
from soter.certificate.reading.folder import MANIFEST_KEYS, Certificate, NotACertificateError
from soter.certificate.reading.module_facts import Facts
from soter.certificate.reading.module_times import TIME_KEYS
from soter.certificate.report import (
    ACCEPTED,
    NOT_RECHECKED,
    REJECTED,
    NotRecheckedError,
    RecheckedModule,
    RejectedError,
    Report,
)
from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.language.evaluate.arithmetic import FaultKind, StepFault
from tables import all_rows
from unit.certificate.test_single_refusals import facts_of

if TYPE_CHECKING:
    from collections.abc import Callable


@pytest.fixture(scope="module")
def two(tmp_path_factory: pytest.TempPathFactory) -> Facts:
    return facts_of(tmp_path_factory.mktemp("two"))


def entry_of(facts: Facts) -> dict[str, Any]:
    """The figures of a manifest as the program has them."""

    def row(x: Any, low: float, high: float) -> dict[str, Any]:
        return {"name": x.name, "kind": x.kind, "low": low.hex(), "high": high.hex()}

    others = [*facts.controls, *facts.disturbances, *facts.errors, *facts.others]
    rows = [row(s, *facts.axes.get(i, (-9.0, 9.0))) for i, s in enumerate(facts.states)]
    rows += [row(x, x.low, x.high) for x in others]
    return {
        "plants": [c.name for c in facts.plants],
        "parameters": [{"name": p.name, "values": list(p.values)} for p in facts.parameters],
        "times": {key: facts.times[key] for key in TIME_KEYS},
        "inputs": rows,
    }


# ---------------------------------------------------------------- figures


def test_the_figures_of_the_program_are_let_through(two: Facts) -> None:
    facts = copy.copy(two)
    rechecker.compare_numbers(facts, entry_of(two))
    assert facts.extents == tuple(two.axes[i] for i in range(2))


def test_an_extent_that_is_open_is_that_of_the_manifest(two: Facts) -> None:
    facts = copy.copy(two)
    facts.axes = {1: two.axes[1]}
    rechecker.compare_numbers(facts, entry_of(facts))
    assert facts.extents == ((-9.0, 9.0), two.axes[1])


WRONG: dict[str, Callable[[dict[str, Any]], object]] = {
    "plants are others": lambda e: e["plants"].reverse(),
    "plants are others (one)": lambda e: e["plants"].pop(),
    "parameters are others": lambda e: e["parameters"].append({"name": "x", "values": []}),
    "`inputs` is not": lambda e: e.update(inputs={}),
    "inputs are others": lambda e: e["inputs"].pop(),
    "inputs are others (more)": lambda e: e["inputs"].append(e["inputs"][-1]),
    "by the program": lambda e: e["inputs"].reverse(),
    "by the program (name)": lambda e: e["inputs"][0].update(name="other"),
    "by the program (kind)": lambda e: e["inputs"][0].update(kind="control"),
    "the grid of": lambda e: e["inputs"][0].update(low=(-2.5).hex()),
    "the grid of (high)": lambda e: e["inputs"][1].update(high=(0.5).hex()),
    "the range of": lambda e: e["inputs"][2].update(low=(-0.5).hex()),
    "the range of (high)": lambda e: e["inputs"][2].update(high=(0.5).hex()),
    "an input has": lambda e: e["inputs"][2].update(unit="m"),
    "an input has (no)": lambda e: e["inputs"][2].pop("kind"),
    "an input is not": lambda e: e["inputs"].__setitem__(0, []),
    "no hexadecimal": lambda e: e["inputs"][0].update(low=-3.0),
}


@all_rows("word", WRONG)
def test_another_figure_is_rejected(two: Facts, word: str) -> None:
    entry = copy.deepcopy(entry_of(two))
    WRONG[word](entry)
    with pytest.raises(RejectedError, match=word.split(" (", maxsplit=1)[0]):
        rechecker.compare_numbers(copy.copy(two), entry)


# ---------------------------------------------------------------- groups


def group_entry(*axes: tuple[str, list[float]], **more: Any) -> dict[str, Any]:
    return {
        "kind": "grid",
        "axes": [{"state": name, "edges": edges} for name, edges in axes],
        "K": "sets/K",
        **more,
    }


P, Q = ("p.p", [-3.0, 0.0, 3.0]), ("q.q", [-1.0, 1.0])


def read_groups(facts: Facts, entries: list[Any], **kinds: Any) -> list[GridGroup]:
    """With tables of the size of each grid."""
    facts = copy.copy(facts)
    facts.extents = ((-3.0, 3.0), (-1.0, 1.0))
    for name, value in kinds.items():
        setattr(facts, name, value)
    contents: dict[str, bytes] = {}
    entries = copy.deepcopy(entries)
    for k, entry in enumerate(entries):
        cells = math.prod(len(axis["edges"]) - 1 for axis in entry["axes"])
        if "K" in entry:
            entry["K"] = f"sets/{k}_K"
            contents[entry["K"]] = bytes(max(cells, 0))
        for axis in entry["axes"]:
            data = np.array(axis["edges"]).tobytes()
            axis["edges"] = f"sets/{k}_{axis['state']}"
            contents[axis["edges"]] = data
    certificate = Certificate(Path(), {}, contents | {"sets/R": bytes([1])}, set())
    return rechecker.read_groups(certificate, facts, entries)


def test_groups_hold_each_state_once(two: Facts) -> None:
    one = read_groups(two, [group_entry(Q, P, R="sets/R")])
    assert [(g.states, g.tables.grid.edges) for g in one] == [((1, 0), (tuple(Q[1]), tuple(P[1])))]
    both = read_groups(two, [group_entry(P), group_entry(Q)])
    assert [g.states for g in both] == [(0,), (1,)]
    assert type(both[0].tables.grid) is Grid
    for wrong in ([], [group_entry(P)], [group_entry(P, Q), group_entry(Q)], [group_entry(P, P)]):
        with pytest.raises(RejectedError, match="exactly once"):
            read_groups(two, wrong)


def test_axes_without_ends_are_those_of_the_program(two: Facts) -> None:
    for open_states in (set(), {0}, {1}, {0, 1}):
        found = read_groups(two, [group_entry(Q, P)], unbounded=open_states)
        ends = tuple(s in open_states for s in (1, 0))
        grid = found[0].tables.grid
        assert [has_no_ends(grid, k) for k in (0, 1)] == [*ends]
        assert isinstance(grid, GridBeyondEnds) is bool(open_states)


WRONG_GROUPS: dict[str, tuple[type[Exception], dict[str, Any]]] = {
    "`ring` groups": (NotRecheckedError, group_entry(P, Q) | {"kind": "ring"}),
    "`None` groups": (NotRecheckedError, {"axes": []}),
    "a group has an unknown": (RejectedError, group_entry(P, Q, X=1)),
    "a group has no `K`": (RejectedError, {"kind": "grid", "axes": []}),
    "an axis has an unknown": (
        RejectedError,
        {"kind": "grid", "K": "", "axes": [{"state": "p.p", "edges": [], "ends": 1}]},
    ),
    "no state `r.r`": (RejectedError, group_entry(P, ("r.r", [0.0, 1.0]))),
    "edges of p.p": (RejectedError, group_entry(("p.p", [-2.5, 3.0]), Q)),
    "edges of q.q": (RejectedError, group_entry(P, ("q.q", [-1.0, 0.0, 0.5]))),
}


@pytest.mark.parametrize("words", WRONG_GROUPS)
def test_groups_that_are_none(two: Facts, words: str) -> None:
    error, entry = WRONG_GROUPS[words]
    with pytest.raises(error, match=words):
        read_groups(two, [entry])


def test_the_dm_has_a_table_for_each_group(two: Facts) -> None:
    """It is that of the sets of all cases, and is handed to the group of each."""

    def group(state: int, edges: list[float], *level: bool) -> GridGroup:
        levels = [np.array(level)] * 2
        grid = Grid((tuple(edges),))
        return GridGroup(GroupTables((state,), grid, np.ones(len(level), np.uint8), levels=levels))

    cases = [
        [group(0, P[1], True, True), group(1, Q[1], True)],
        [group(0, P[1], False, True), group(1, Q[1], True)],
    ]
    contents = {
        "sets/p": np.array(P[1]).tobytes(), "sets/q": np.array(Q[1]).tobytes(),
        "sets/of_p": packed_levels(np.array([0, 2], np.uint8)),
        "sets/of_q": packed_levels(np.array([2], np.uint8)),
    }  # fmt: skip
    certificate = Certificate(Path(), {}, contents, set())
    entries: list[Any] = [
        {"axes": [{"state": f"{n}.{n}", "edges": f"sets/{n}"}], "levels": f"sets/of_{n}"}
        for n in "pq"
    ]
    estimates_and_shield.compare_tables(certificate, two, cases, entries)
    for of_p, of_q in cases:
        given = [of.tables.given_back for of in (of_p, of_q)]
        assert [of.tolist() for of in given if of is not None] == [[False, True], [True]]
    with pytest.raises(RejectedError, match="other axes"):
        estimates_and_shield.compare_tables(certificate, two, cases, entries[::-1])
    for wrong in (entries[:1], [*entries, entries[1]], []):
        with pytest.raises(RejectedError, match="one for each group"):
            estimates_and_shield.compare_tables(certificate, two, cases, wrong)
    cases[1].pop()
    with pytest.raises(RejectedError, match="other groups"):
        estimates_and_shield.compare_tables(certificate, two, cases, entries)


# ---------------------------------------------------------------- modules and reports


def test_why_something_is_not_rechecked() -> None:
    for error, words in (
        (NotRecheckedError("as it is"), "as it is"),
        (StepFault(FaultKind.INDEX), "a step that faults"),
        (BrokenExecutor("gone"), "the system ended a part of it: gone"),
        (OSError("gone"), "the system ended a part of it: gone"),
        (RecursionError("deep"), "recursionerror: deep"),
        (MemoryError("much"), "memoryerror: much"),
        (ValueError("odd"), "the re-checker itself failed (ValueError: odd)"),
    ):
        assert rechecker.reason_in_words(error).startswith(words)
        assert ("itself failed" in rechecker.reason_in_words(error)) is isinstance(
            error, ValueError
        )


@pytest.mark.parametrize("reasons", [[""], ["", ""], ["x"], ["", "x"], ["x", "y"]])
def test_all_modules_are_rechecked_or_it_is_not_accepted(reasons: list[str]) -> None:
    report = Report()
    report.modules = [RecheckedModule(f"M{k}", {}, not_rechecked=r) for k, r in enumerate(reasons)]
    rechecker._set_verdict(report)
    left = [f"M{k}: {r}" for k, r in enumerate(reasons) if r]
    assert report.verdict == (NOT_RECHECKED if left else ACCEPTED)
    assert report.reason == "; ".join(left)


def rechecked(monkeypatch: pytest.MonkeyPatch, says: object, **more: Any) -> tuple[Any, list[Any]]:
    """The report where the check does this, and with what it is called."""
    asked: list[Any] = []

    def check(_: object, report: Report, workers: int) -> None:
        asked.append(workers)
        if isinstance(says, Exception):
            raise says
        report.modules.append(RecheckedModule("M", {}))

    clock = iter((10.0, 12.5))
    monkeypatch.setattr(rechecker, "time", SimpleNamespace(perf_counter=lambda: next(clock)))
    monkeypatch.setattr(rechecker, "read_certificate", lambda _: SimpleNamespace(seal="seal"))
    monkeypatch.setattr(rechecker, "_check_certificate", check)
    none: Any = None
    return rechecker.recheck(none, **more), asked


def program_error(*codes: Any) -> SoterError:
    return SoterError(tuple(Diagnostic(code, f"what {code} says") for code in codes))


@pytest.mark.parametrize("codes", [("D007",), ("D007", "N001"), ("N001", "D007"), ("N001",), ()])
def test_a_program_with_errors_is_rejected_unless_nothing_is_known(
    monkeypatch: pytest.MonkeyPatch, codes: tuple[str, ...]
) -> None:
    error = program_error(*codes)
    if "D007" in codes:
        with pytest.raises(SoterError):
            rechecked(monkeypatch, error)
    else:
        report, _ = rechecked(monkeypatch, error)
        assert report.verdict == REJECTED
        assert report.reason.startswith("the program of the certificate")


def test_whatever_is_raised_is_not_accepted(monkeypatch: pytest.MonkeyPatch) -> None:
    for error, verdict, reason in (
        (RejectedError("wrong"), REJECTED, "wrong"),
        (NotRecheckedError("odd"), NOT_RECHECKED, "odd"),
        (ValueError("x"), NOT_RECHECKED, "the re-checker itself failed (ValueError: x)"),
        (None, ACCEPTED, ""),
    ):
        report, _ = rechecked(monkeypatch, error)
        assert (report.verdict, report.reason) == (verdict, reason)
        assert (report.seal, report.seconds) == ("seal", 2.5)
    with pytest.raises(NotACertificateError):
        rechecked(monkeypatch, NotACertificateError("none"))


@pytest.mark.parametrize("processors", [None, 1, 3])
def test_as_many_processes_as_are_asked_for(
    monkeypatch: pytest.MonkeyPatch, processors: int | None
) -> None:
    monkeypatch.setattr(rechecker, "os", SimpleNamespace(cpu_count=lambda: processors))
    for given, wanted in ((None, processors or 1), (2, 2), (1, 1)):
        _, asked = rechecked(monkeypatch, None, workers=given)
        assert asked == [wanted]


class Checked:
    """What `_entry` does, said by a list."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, says: list[Any]) -> None:
        self.says = iter(says)
        self.looked_at: list[Any] = []
        program = SimpleNamespace(sha256="hash")
        checked = SimpleNamespace(program=program)
        monkeypatch.setattr(rechecker, "read_program", lambda _: (checked, {}))
        monkeypatch.setattr(rechecker, "_check_entry", self.entry)
        monkeypatch.setattr(rechecker, "open_questions", lambda *_: [])
        monkeypatch.setattr(rechecker, "_require_all_views", lambda f, _: self.looked_at.append(f))

    def entry(self, _: object, __: object, ___: object, covered: list[Any], *____: object) -> Any:
        said = next(self.says)
        if isinstance(said, Exception):
            raise said
        covered.append(said.name)
        return said

    def check(self, unused: list[str], **first: str) -> Report:
        keys = dict.fromkeys(MANIFEST_KEYS.split(), "")
        modules = [
            {"module": f"M{k}", "system": "S", **(first if k == 0 else {})} for k in range(2)
        ]
        certificate: Any = SimpleNamespace(
            manifest={**keys, "modules": modules}, unused_tables=unused
        )
        report = Report()
        rechecker._check_certificate(certificate, report, 1)
        return report


def module(name: str, system: str = "S") -> RecheckedModule:
    return RecheckedModule(name, {}, system=system)


def test_each_module_is_told_once(monkeypatch: pytest.MonkeyPatch) -> None:
    for second, told in ((module("M1"), 2), (module("M0"), 1), (module("M0", "T"), 2)):
        checked = Checked(monkeypatch, [module("M0"), second])
        report = checked.check([])
        assert len(report.modules) == told
        assert len(checked.looked_at) == 2
        assert report.program_sha256 == "hash"
    checked = Checked(monkeypatch, [module("M0"), module("M1")])
    with pytest.raises(RejectedError, match="no claim rests on `sets/x`"):
        checked.check(["sets/x"])


@pytest.mark.parametrize("view", ["", "near"])
def test_where_one_module_is_not_rechecked_the_other_is(
    monkeypatch: pytest.MonkeyPatch, view: str
) -> None:
    checked = Checked(monkeypatch, [ValueError("odd"), module("M1")])
    report = checked.check(["sets/x"], **({"view": view} if view else {}))
    first, second = report.modules
    assert (first.name, first.system) == (f"M0{' as near' * bool(view)}", "S")
    assert "odd" in first.not_rechecked
    assert not second.not_rechecked
    assert not checked.looked_at


@pytest.mark.parametrize("error", [RejectedError("wrong"), SoterError(())])
def test_what_is_wrong_of_one_module_is_so_of_all(
    monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    with pytest.raises(type(error)):
        Checked(monkeypatch, [error, module("M1")]).check([])


def test_a_module_stands_there_once(monkeypatch: pytest.MonkeyPatch) -> None:
    def covered(system: str, name: str, view: str | None) -> Any:
        own: Any = SimpleNamespace() if view is None else Facts.__new__(Facts)
        own.flying, own.flying_module = SimpleNamespace(name=system), SimpleNamespace(name=name)
        if view is not None:
            own.view = view
        return own

    rows = [("S", "M", ""), ("S", "M", "near"), ("T", "M", ""), ("S", "N", ""), ("S", "M", None)]
    for name in ("_system_of_entry", "param_values"):
        monkeypatch.setattr(rechecker, name, lambda *_: None)
    monkeypatch.setattr(rechecker, "other_values_in_program", lambda *_: ([], []))
    monkeypatch.setattr(rechecker, "_check_module", lambda *_: SimpleNamespace())
    entry: Any = dict.fromkeys(rechecker.MODULE_KEYS.split())
    none: Any = None
    for one, other in itertools.product(rows[:4], rows):
        known = [covered(*other)]
        monkeypatch.setattr(rechecker, "read_problem", lambda *_, one=one: covered(*one))
        same = (one[0], one[1], one[2]) == (other[0], other[1], other[2] or "")
        if same:
            with pytest.raises(RejectedError, match="twice"):
                rechecker._check_entry(none, none, none, known, entry, 1)
        else:
            rechecker._check_entry(none, none, none, known, entry, 1)
            assert len(known) == 2


def test_a_module_of_a_whole_proof_is_checked_by_its_method(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    facts = SimpleNamespace(
        flying=SimpleNamespace(name="S"), flying_module=SimpleNamespace(name="M")
    )
    monkeypatch.setattr(rechecker, "_system_of_entry", lambda *_: "system")
    monkeypatch.setattr(rechecker, "param_values", lambda of: of)
    monkeypatch.setattr(rechecker, "other_values_in_program", lambda *_: (["a"], ["b"]))
    monkeypatch.setattr(rechecker, "_check_module", lambda *_: pytest.fail("no groups there"))
    asked = []
    for key in MODULES:

        def check(system: Any, entry: Any) -> Any:
            asked.append((system, entry))
            return facts, SimpleNamespace()

        monkeypatch.setitem(MODULES, key, partial(SimpleNamespace, check=check))
        known: list[Any] = []
        none: Any = None
        report: Any = rechecker._check_entry(none, none, none, known, {key: 1}, 1)
        assert asked[-1] == ("system", {key: 1})
        assert known == [facts]
        assert (report.parameters, report.otherwise, report.contradicted) == (
            facts.flying,
            ["a"],
            ["b"],
        )
    others: tuple[Any, ...] = (None, [], "text")
    for wrong in others:
        with pytest.raises(RejectedError, match="a module is not"):
            rechecker._check_entry(none, none, none, [], wrong, 1)


@pytest.mark.parametrize("why", ["", "`near` is left out"])
def test_a_module_is_proved_in_all_its_views(monkeypatch: pytest.MonkeyPatch, why: str) -> None:
    def of(name: str, view: str, system: str = "S") -> Any:
        facts: Any = Facts.__new__(Facts)
        facts.flying = SimpleNamespace(name=system)
        facts.flying_module = SimpleNamespace(name=name)
        facts.view, facts.whole = view, f"all of {name}"
        return facts

    asked: list[Any] = []

    def left_out(whole: object, views: object) -> str:
        asked.append((whole, views))
        return why

    monkeypatch.setattr("soter.certificate.extras.views.why_views_leave_out", left_out)
    covered = [of("M", "near"), of("M", "far"), of("N", "near"), of("M", "near", "T"), of("O", "")]
    covered.append(SimpleNamespace())
    if why:
        with pytest.raises(RejectedError, match="left out"):
            rechecker._require_all_views(covered[0], covered)
    else:
        rechecker._require_all_views(covered[0], covered)
    assert asked == [("all of M", ["near", "far"])]
    for facts in covered[-2:]:
        rechecker._require_all_views(facts, covered)
    assert len(asked) == 1


def test_a_system_of_the_program(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def prepared(*of: object, exact: bool) -> str:
        asked.append((of, exact))
        return "flat"

    monkeypatch.setattr(rechecker, "system_to_prove", prepared)
    checked: Any = SimpleNamespace(systems={"S": None})
    flat: Any = rechecker._system_of_entry(checked, {"a": 1}, {"system": "S"})
    assert flat == "flat"
    assert asked == [((checked, "S", {"a": 1}), False)]
    with pytest.raises(RejectedError, match="no system `T`"):
        rechecker._system_of_entry(checked, {}, {"system": "T"})


@pytest.mark.parametrize("error", [KeyError("x"), TypeError(), AttributeError(), IndexError()])
def test_a_manifest_that_is_not_understood_is_at_fault(error: Exception) -> None:
    with (
        pytest.raises(RejectedError, match="not as it should be"),
        rechecker._rejecting_malformed("it"),
    ):
        raise error
