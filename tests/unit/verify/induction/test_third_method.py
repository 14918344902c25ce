"""A third method of proof needs one row in each of two tables: enumeration of finitely many states.

The toy proves groups of one axis whose state is always one of the axis's breakpoints, by looking at
each of them. Nothing in `verify/` knows of it but `METHODS`, and nothing in `certificate/` but
`GROUPS`.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import pytest

from soter.certificate.folder import RETURN
from soter.certificate.proof_methods import GROUPS, GroupMethod
from soter.language.front_end import check_file, system_of
from soter.verify import command
from soter.verify.claims.case import GroupProof, Method
from soter.verify.claims.product_sets import BoxPart
from soter.verify.claims.results import VerifyReport
from soter.verify.deploy.level_tables import GroupTable
from soter.verify.problem.extract import extract
from soter.verify.proof_methods import METHODS, entry_over_sets
from soter.verify.proof_report import page
from soter.verify.verify_module import verify_module

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from soter.report.proof_page import RegionFigure
    from soter.verify.claims.case import Case
    from soter.verify.claims.product_sets import SetFactor
    from soter.verify.claims.results import ModuleResult
    from soter.verify.deploy.level_tables import LevelTable
    from soter.verify.problem.problem import Group, Problem

    Set = frozenset[float]
    Floats = NDArray[np.float64]

LETS = {"ttf": 1, "safer": 2}
WALK = """soter 1;
topic x: float in [-9.0, 9.0] max_age 15ms;
topic u: float in [-1.0, 1.0];
plant P period 20ms {
  reads u;
  drives x = p;
  state p: float;
  next p = p + (u > 0.5 ? 1.0 : 0.0) - (u < -0.5 ? 1.0 : 0.0);
}
node Away period 20ms { publishes u; step { publish u = 1.0; } }
node Back period 20ms {
  subscribes x;
  publishes u;
  step { publish u = x > 0.5 ? -1.0 : (x < -0.5 ? 1.0 : 0.0); }
}
rta M {
  ac Away;
  sc Back;
  period 20ms;
  safe abs(x) < 5.5;
  ttf abs(x) > 1.5;
  safer abs(x) < 1.5;
  verify { grid x in [-6.0, 6.0] / 12; }
}
system S { p: P; module M; }
"""
COMPUTED = (("  ttf abs(x) > 1.5;\n", ""), ("  safer abs(x) < 1.5;\n", ""))


@dataclass
class Sets:
    """Values: C, K, R(H), Q, and levels of estimates."""

    allowed: Set = frozenset()
    core: Set = frozenset()
    free: Set = frozenset()
    home: Set = frozenset()
    levels: tuple[Set, ...] = ()
    lets: dict[str, Set] = field(default_factory=dict)


class FiniteProof(GroupProof):
    """Sets of values of one state."""

    mark = "f"
    found: Sets

    def __init__(self, case: Case, group: Group) -> None:
        (self.axis,) = group.axes
        self.case, self.group, self.found, self.fresh = case, group, Sets(), True
        self.all = self.axis.edges

    def box(self, value: float) -> Floats:
        """All inputs, with the state at a value."""
        box: Floats = self.case.forms.whole.copy()
        box[self.axis.state] = value
        return box

    def after(self, value: float, *, law: bool) -> Set:
        """Where the state may be after a step of SC, or of any control."""
        problem, box = self.case.problem, self.box(value)
        first = len(problem.states)
        if law:
            published = self.case.forms.numbers("law", box, len(problem.controls))
            assert published is not None
            box[first : first + len(published)] = published
        moved = self.case.forms.numbers("next", box, len(problem.states))
        assert moved is not None
        low, high = moved[self.axis.state]
        return frozenset(v for v in np.arange(np.ceil(low), np.floor(high) + 1).tolist())

    def kept(self, inside: Set) -> Set:
        """The greatest part that SC keeps."""
        left = inside
        while lost := {v for v in left if not self.after(v, law=True) <= left}:
            left -= lost
        return left

    def within(self, inside: Set, ns: int) -> Set:
        """From where no control leaves a set for so long."""
        left = inside
        for _ in range(-(-ns // self.case.problem.plant_period_ns)):
            left = frozenset(v for v in left if self.after(v, law=False) <= left)
        return left

    def take_constraint(self, case: Case, part: SetFactor) -> None:
        del case
        low, high = cast("BoxPart", part).box[self.axis.state]
        self.found.allowed = frozenset(v for v in self.all if low <= v <= high)

    def core(self, case: Case) -> bool:
        self.found.core = self.kept(self.found.allowed)
        if not self.found.core:
            case.fail("P2a", "SC keeps no state of those that there are", self)
        return bool(self.found.core)

    def free_phase(self, case: Case) -> None:
        horizon = case.problem.in_horizon(case.problem.times.horizon_ns)
        self.found.free = self.within(self.found.core, horizon)

    def inclusion(self, case: Case, predicate: str) -> None:
        lets = LETS[predicate]
        truth = {v: case.forms.truth(predicate, self.box(v)) for v in self.found.allowed}
        self.found.lets[predicate] = frozenset(v for v, bits in truth.items() if bits & lets)
        wrong = self.found.lets[predicate] - self.found.free
        if wrong:
            case.fail(predicate, f"`{predicate}` lets AC have control at {sorted(wrong)}", self)

    def levels(self, case: Case) -> None:
        inner = self.within(self.found.free, case.problem.in_horizon(case.problem.times.decision))
        self.found.levels = (self.found.free, inner)

    def take_table(self, case: Case, table: LevelTable) -> None:
        del case
        assert isinstance(table, GroupTable)

    def start(self, case: Case, until_ns: int) -> None:
        initial = case.problem.initial[self.axis.state]
        safe = self.within(self.found.core, until_ns)
        if not {v for v in self.all if initial.low <= v <= initial.high} <= safe:
            case.fail("start", "an initial state is lost before SC acts", self)

    def states_given_back(self, case: Case) -> BoxPart | None:
        del case
        values = self.found.levels[1]
        return BoxPart({self.axis.state: (min(values), max(values))}) if values else None

    def recover(self, case: Case, target: SetFactor) -> None:
        low, high = cast("BoxPart", target).box[self.axis.state]
        self.found.home = left = self.kept(
            frozenset(v for v in self.found.allowed if low <= v <= high)
        )
        steps = 0
        while left < self.found.core:
            more = {v for v in self.found.core if self.after(v, law=True) <= left}
            if more <= left:
                case.fail("P2b", "SC never returns", self)
                return
            left, steps = left | more, steps + 1
        self.return_ns = steps * case.problem.times.delta_sc

    def shares(self, case: Case) -> dict[str, float]:
        del case
        return {"core": len(self.found.core) / len(self.all)}

    def random_states(self, chance: np.random.Generator, count: int) -> Floats:
        return chance.choice(sorted(self.found.core), (count, 1))

    @property
    def pair(self) -> tuple[Set, Set] | None:
        return self.found.levels or None  # type: ignore[return-value]

    def entry(self, problem: Problem, stem: str, files: dict[str, bytes]) -> dict[str, object]:
        del problem
        sets = {"K": self.found.core, "Q": self.found.home}
        files |= {f"{stem}_{n}.bin": np.array(sorted(s)).tobytes() for n, s in sets.items()}
        return {"kind": "finite", **{name: f"{stem}_{name}.bin" for name in sets}}

    def figures(self, note: str) -> list[RegionFigure]:
        del note
        return []


class Finite(Method):
    """One state after the other."""

    kind = "finite"
    how = dict.fromkeys(("P2a", "P2b", "ttf", "safer", "start"), "every state there is")

    def new_proof(self, case: Case, group: Group) -> FiniteProof:
        return FiniteProof(case, group)

    def parts(
        self, case: Case, proofs: Sequence[GroupProof], predicate: str
    ) -> list[BoxPart] | None:
        parts = []
        for proof in cast("Sequence[FiniteProof]", proofs):
            good = [v for v in proof.all if case.forms.true(predicate, proof.box(v))]
            if not good:
                return None
            parts.append(BoxPart({proof.axis.state: (min(good), max(good))}))
        return parts

    def proved_in_words(self, done: Sequence[Case], claim: str) -> tuple[str, dict[str, int]]:
        states = sum(len(cast("FiniteProof", p).found.core) for c in done for p in c.proofs)
        return f"{claim}: {states} states", {"states": states}

    def table(self, problem: Problem, group: Group, pairs: Sequence[object]) -> GroupTable:
        del problem
        (axis,) = group.axes
        edges = (axis.edges[0] - 0.5, *(v + 0.5 for v in axis.edges))
        every = cast("Sequence[tuple[Set, Set]]", pairs)
        levels = [min((v in s) + (v in t) for s, t in every) for v in axis.edges]
        return GroupTable((axis.state,), (edges,), np.array(levels, dtype=np.uint8))

    def pack(self, pair: object) -> dict[str, NDArray[np.generic]]:
        both = enumerate(cast("tuple[Set, Set]", pair))
        return {str(k): np.array(sorted(values)) for k, values in both}

    def unpack(self, group: Group, arrays: Mapping[str, NDArray[np.generic]]) -> tuple[Set, Set]:
        del group
        return frozenset(arrays["0"].tolist()), frozenset(arrays["1"].tolist())


@pytest.fixture(autouse=True)
def _registered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(METHODS, "finite", Finite())
    method = GroupMethod(lambda: pytest.fail("no prover reads one"), {"Q": RETURN}, ())
    monkeypatch.setitem(GROUPS, "finite", method)


def verified(*changes: tuple[str, str]) -> ModuleResult:
    text = WALK
    for old, new in changes:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    checked = check_file("walk.soter", text)
    assert checked.ok, [d.message for d in checked.diagnostics.items]
    flat = system_of(checked, None)
    problem = extract(flat, flat.modules[0])
    finite = tuple(replace(g, representation="finite") for g in problem.groups)
    return verify_module(replace(problem, groups=finite), refute=False)


def sets_of(result: ModuleResult) -> Sets:
    (proof,) = result.cases[0].proofs
    assert isinstance(proof, FiniteProof)
    return proof.found


def test_every_claim_is_proved_by_looking_at_every_state() -> None:
    module_result = verified()
    assert {n: f.verdict for n, f in module_result.findings.items() if f.verdict != "proved"} == {
        "P1c": "assumed",
        "failsafe": "assumed",
    }
    assert module_result.findings["P2a"].method == "every state there is"
    assert "11 states" in module_result.findings["P2a"].text
    assert module_result.findings["P2a"].counts["states"] == 11
    assert sets_of(module_result).core == frozenset(range(-5, 6))
    assert module_result.shares["core"] == pytest.approx(11 / 13)


def test_what_is_wrong_stays_undecided() -> None:
    stuck = verified(("x > 0.5 ? -1.0", "x > 0.5 ? 0.0"))
    assert stuck.findings["P2a"].verdict == "proved", "it stays where it is"
    assert stuck.findings["P2b"].text == "SC never returns"
    away = verified(
        ("x > 0.5 ? -1.0", "x > 0.5 ? 1.0"), ("x < -0.5 ? 1.0 : 0.0", "false ? 1.0 : 1.0")
    )
    assert away.findings["P2a"].text == "SC keeps no state of those that there are"
    bold = verified(("abs(x) > 1.5", "abs(x) > 5.2"))
    assert bold.findings["ttf"].verdict == "undecided"
    assert bold.findings["P3"].verdict == "undecided"


def test_computed_predicates_are_a_table_that_the_dm_reads() -> None:
    module_result = verified(*COMPUTED)
    assert module_result.findings["ttf"].text == "`ttf` is computed from the sets"
    assert module_result.findings["DM"].verdict == "proved"
    assert "all 13 cells" in module_result.findings["DM"].text


def test_certificate_and_report_are_written_by_the_method(tmp_path: Path) -> None:
    (tmp_path / "walk.soter").write_text(WALK)
    program = check_file(str(tmp_path / "walk.soter")).program
    assert program is not None
    module_result = verified()
    command.write_certificate(tmp_path / "cert", program, [module_result], ["S"])
    manifest = json.loads((tmp_path / "cert" / "manifest.json").read_text())
    (group,) = manifest["modules"][0]["cases"][0]["groups"]
    assert group["kind"] == "finite"
    stored = (tmp_path / "cert" / group["K"]).read_bytes()
    assert manifest["files"][group["K"]] == hashlib.sha256(stored).hexdigest()
    assert np.frombuffer(stored).tolist() == list(range(-5, 6))
    report = VerifyReport("walk.soter", program.sha256, "S", (module_result,), 0.0)
    assert page(report).modules[0].figures == ()


def test_what_no_claim_rests_on_is_left_out_of_the_certificate() -> None:
    stuck = verified(("x > 0.5 ? -1.0", "x > 0.5 ? 0.0"))
    assert stuck.findings["P2b"].verdict == "undecided"
    for result, parts in ((verified(), ["K", "Q"]), (stuck, ["K"])):
        files: dict[str, bytes] = {}
        entry: Any = entry_over_sets(result, "S", "sets/0", files)
        (group,) = entry["cases"][0]["groups"]
        assert group == {"kind": "finite"} | dict(zip(parts, files, strict=True))
