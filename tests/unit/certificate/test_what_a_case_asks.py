"""What is asked of each group of a case, in which order, and what has to be answered."""

from __future__ import annotations

import dataclasses
from functools import partial
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest

from soter.certificate import case_check, rechecker
from soter.certificate.case_check import CaseCheck, narrowed_extents
from soter.certificate.cell_sets import Axes, Grid
from soter.certificate.extras import left_out_states, sc_locals_and_modes
from soter.certificate.reading.case_model import CaseModel
from soter.certificate.report import (
    NotRecheckedError,
    RejectedError,
)
from soter.diagnostics.current_phase import whole_shares_to
from tables import all_rows
from unit.certificate.test_single_refusals import facts_of

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path


def test_ranges_are_those_of_the_grids() -> None:
    def part(states: tuple[int, ...], *edges: tuple[float, ...]) -> Axes:
        return Axes(states, Grid(edges))

    extents = ((0.0, 1.0), (2.0, 3.0), (4.0, 5.0))
    assert narrowed_extents(extents, []) == extents
    found = narrowed_extents(extents, [part((2, 0), (6.0, 7.0, 8.0), (9.0, 10.0)), part(())])
    assert found == ((9.0, 10.0), (2.0, 3.0), (6.0, 8.0))


def case(monkeypatch: pytest.MonkeyPatch, claims: set[str], **facts: Any) -> tuple[Any, list[str]]:
    """A case with two groups, and what it asks them."""
    asked: list[str] = []

    def noted(what: str, answer: Any = ()) -> Any:
        asked.append(what)
        return answer

    def check(k: int) -> Any:
        return SimpleNamespace(
            shows_rates_defined=k == 1,
            free_tasks=lambda h: noted(f"free {k} {h}"),
            tasks_for_levels=lambda ns: noted(f"levels {k} {ns}"),
            core_tasks=lambda: noted(f"core {k}"),
            note_safe_cells=lambda cells: asked.append(f"safe {k} {cells}"),
            predicate_tasks=lambda name, expr, admits: noted(f"{name} {k} {expr} {admits}"),
            keep_in_topic_set=lambda t, cells: noted(f"published {k} {t} {cells}"),
            return_tasks=lambda cells: noted(f"home {k} {cells}"),
            holds_to_return=k + 1,
        )

    groups = [
        SimpleNamespace(
            make_check=lambda _, kept, k=k: noted(f"kept {k} {kept}", check(k)),
            tables="part",
            states=(k,),
        )
        for k in range(2)
    ]
    symbol = SimpleNamespace(safe="safe", safer="safer", verify=SimpleNamespace(recover=None))
    known = {
        "unbounded": set(),
        "times": {"H_ns": 7},
        "is_computed": False,
        "ns_between_verdicts": 3,
    }
    own = SimpleNamespace(symbol=symbol, ttf="ttf", in_sets=(), **{**known, **facts})
    monkeypatch.setattr(
        left_out_states, "require_unread_states", lambda _, n: asked.append(f"reads {n}")
    )
    monkeypatch.setattr(
        case_check, "require_defined_rates", lambda _, s: asked.append(f"rates {s}")
    )
    monkeypatch.setattr(case_check, "bounded_topics", lambda _: ["t"])
    monkeypatch.setattr(case_check, "cells_published_in_set", lambda *_: ["c0", "c1"])
    model: Any = SimpleNamespace(facts=own, parameter=(), extents=())
    made = CaseCheck(model, groups, claims, {"recover_ns": None}, 1)  # type: ignore[arg-type]
    monkeypatch.setattr(
        CaseCheck,
        "_certain_cells",
        lambda _, expr, errors: [f"{expr} {errors} {k}" for k in range(2)],
    )
    monkeypatch.setattr(CaseCheck, "_add_start_tasks", lambda _: asked.append("start"))
    return made, asked


KERNEL = ["safe 0 safe False 0", "safe 1 safe False 1"]
KERNEL += ["published 0 t c0", "published 1 t c1", "core 0", "core 1"]
FREE = ["free 0 7", "free 1 7"]
HOME = ["home 0 safer True 0", "home 1 safer True 1"]
TTF, SAFER = ([f"{n} {k} {n} {a}" for k in range(2)] for n, a in (("ttf", False), ("safer", True)))


@pytest.mark.parametrize(
    ("claims", "wanted"),
    [
        ({"P1a"}, []),
        ({"P2a"}, KERNEL),
        ({"P2b"}, KERNEL + HOME),
        ({"P3"}, KERNEL + FREE + TTF + SAFER),
        ({"ttf"}, KERNEL + FREE + TTF),
        ({"safer"}, KERNEL + FREE + SAFER),
        ({"start"}, [*KERNEL, "start"]),
        ({"P1a", "P2a", "P2b", "P3"}, KERNEL + FREE + TTF + SAFER + HOME),
    ],
)
def test_what_is_asked_of_each_group(
    monkeypatch: pytest.MonkeyPatch, claims: set[str], wanted: list[str]
) -> None:
    made, asked = case(monkeypatch, claims)
    made._collect_tasks()
    assert asked == ["kept 0 None", "kept 1 None", "rates [(1,)]", *wanted]
    assert made.model.facts.in_sets == (("t",) if claims != {"P1a"} else ())


def test_of_computed_predicates_levels_are_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    made, asked = case(monkeypatch, {"P3"}, is_computed=True, unbounded={0})
    made.lawful = ["l0", "l1"]
    made._collect_tasks()
    assert asked[:4] == ["kept 0 l0", "kept 1 l1", "reads 2", "rates [(1,)]"]
    assert asked[4:] == [*KERNEL, *FREE, "levels 0 3", "levels 1 3"]


def test_predicates_that_are_not_there_are_not_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    for missing, claims in (("ttf", {"ttf"}), ("safer", {"safer"}), ("safer", {"P3"})):
        made, _ = case(monkeypatch, claims)
        setattr(made.model.facts if missing == "ttf" else made.model.facts.symbol, missing, None)
        made.checks = []
        with pytest.raises(NotRecheckedError, match="computed predicates"):
            made._add_predicate_tasks()


@pytest.mark.parametrize("late", [0, 1])
@pytest.mark.parametrize("decide", [0, 2])
def test_the_time_to_return_is_the_longest_way(
    monkeypatch: pytest.MonkeyPatch, late: int, decide: int
) -> None:
    made, _ = case(
        monkeypatch, {"P2b"}, times={"delta_ns": 10}, jitter_ns=late, verdict_delay_ns=decide
    )
    monkeypatch.setattr(case_check, "const_value", lambda _, declared: declared)
    made._compare_recover_time()  # none is declared
    made.entry = {"recover_ns": 25}
    with pytest.raises(RejectedError, match="declares no time"):
        made._compare_recover_time()
    for holds in ((), (2,), (1, 2), (2, 1)):
        made.checks = [SimpleNamespace(holds_to_return=h) for h in holds]
        longest = 10 * max(holds, default=0) + late + decide
        for declared in (longest - 1, longest, longest + 1):
            made.model.facts.symbol.verify.recover = declared
            made.entry = {"recover_ns": declared}
            if declared >= longest:
                made._compare_recover_time()
            else:
                with pytest.raises(RejectedError, match="longer to return"):
                    made._compare_recover_time()
            for other in (declared + 1, None):
                made.entry = {"recover_ns": other}
                with pytest.raises(RejectedError, match="another one"):
                    made._compare_recover_time()


@pytest.mark.parametrize("default", [-2.0, -1.0, 0.5, 2.0, 2.5])
def test_the_default_of_a_command_lies_in_its_set(tmp_path: Path, default: float) -> None:
    push = ("topic u: float in [-1.0, 1.0];", "topic u: float in [-1.0, 2.0] = 0.5;")
    facts = facts_of(tmp_path, push)
    (control,) = facts.controls
    facts.controls = [dataclasses.replace(control, leaf=1)]
    facts.system.topics[control.owner].default = (9.0, default)
    model = CaseModel(facts, (), ((-3.0, 3.0), (-1.0, 1.0)))
    made = CaseCheck(model, [], {"start"}, {}, 1)
    if -1.0 <= default <= 2.0:
        made._add_start_tasks()
    else:
        with pytest.raises(RejectedError, match="the default of `u`"):
            made._add_start_tasks()


@pytest.mark.parametrize("fork", [False, True])
@pytest.mark.parametrize("workers", [1, 2, 9])
def test_every_task_has_to_say_nothing(
    monkeypatch: pytest.MonkeyPatch, fork: bool, workers: int
) -> None:
    used: list[int] = []

    class Processes:
        def __init__(self, count: int, task: Callable[[int], str], workers: int) -> None:
            used.append(workers)
            self.done = ((k, task(k)) for k in range(count))

        def answers(self) -> Any:
            yield from self.done

    monkeypatch.setattr(case_check, "TaskProcesses", Processes)
    monkeypatch.setattr(case_check, "can_fork", lambda: fork)
    parameters = [SimpleNamespace(name="a"), SimpleNamespace(name="b")]

    def show(*failed: str, named: bool = True) -> tuple[list[float], list[int]]:
        shares: list[float] = []
        order: list[int] = []
        facts = SimpleNamespace(parameters=parameters if named else [], times={"d_ns": 0})
        model: Any = SimpleNamespace(facts=facts, parameter=(1, 2) if named else ())
        made = CaseCheck(model, [], set(), {}, workers)

        def task(k: int, text: str) -> str:
            order.append(k)
            return text

        made.tasks = [(partial(task, k, text), k + 1) for k, text in enumerate(failed)]
        with whole_shares_to(shares.append):
            made._run_tasks()
        return shares, order

    shares, order = show("", "", "")
    assert order == [2, 1, 0]
    assert shares == [3 / 6, 5 / 6, 1.0]
    assert used == ([min(workers, 3)] if fork and workers > 1 else [])
    assert show() == ([], [])
    for k in range(3):
        with pytest.raises(RejectedError, match=r"^wrong \(a = 1, b = 2\)$"):
            show(*("wrong" if k == i else "" for i in range(3)))
    with pytest.raises(RejectedError, match=r"^wrong$"):
        show("wrong", named=False)


@all_rows(("first", "phase"), [(0, 0), (5, 0), (3, 3), (3, 4)])
def test_when_the_start_of_sc_is_asked_about(
    monkeypatch: pytest.MonkeyPatch, first: int, phase: int
) -> None:
    done: list[str] = []
    reads = [SimpleNamespace()]
    setting = SimpleNamespace(
        by_sc=reads,
        sc=SimpleNamespace(phase=phase),
        release_with_state=lambda after, of: first if (after, of) == (0, reads) else -1,
    )
    facts = SimpleNamespace(setting=setting, levels=3)
    monkeypatch.setattr(rechecker, "read_facts", lambda *_: facts)
    for of, name in (
        (rechecker, "require_supported"),
        (sc_locals_and_modes, "check_start_answers"),
    ):
        monkeypatch.setattr(of, name, lambda _, name=name: done.append(name))
    none: Any = None
    found: Any = rechecker.read_problem(none, {"module": "M"})
    assert found is facts
    assert done == ["require_supported"] + ["check_start_answers"] * (first != phase)
