"""What decision modules of a run saw and did, why, and where SC would have led from there.

Purpose: `decision_steps` gives every DM step of a trace, and `change_records` every change of mode,
as plain records for logs, reports and terminals. For a decision module with `rest`, `TubeLooks`
compiles the predicates of a system and asks them again about a state, with a note behind each call
of `flow`, `safe`, `rests` and `settles` (`verify/tubes/*.soter`): boxes of the tube, and the part
that is not shown. All arithmetic is that of the C that flies.
Non-goals: deciding (the generated DM did), drawing (`report/run/where_sc_leads.py`).
"""

from __future__ import annotations

import contextlib
import ctypes
import re
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from soter.codegen.unit import UnitBuilder
from soter.core.layout import state_dtype
from soter.core.steps import lower
from soter.diagnostics.diagnostic import SoterError
from soter.language.model import typed
from soter.language.model.tree_walk import calls_in, children
from soter.native.shared_library import library
from soter.report.run.where_sc_leads import FAILED
from soter.semantics.configuration import ACKNOWLEDGED, OPEN, READY
from soter.simulate.explain_decision import (
    DecisionReason,
    Explainer,
    TopicRead,
    leaf_path_name,
    published_before,
)
from soter.simulate.run_observer import decided_rows

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import numpy.typing as npt

    from soter.core.layout import StateLayout
    from soter.language.model.system import Module, System
    from soter.simulate.run_observer import ModeChange


ROOM = 8192
"""The most boxes of one look that are kept."""
GOOD, SAFE, REST, MOVES, BOUNDED = range(5)
TOLD = {
    SAFE: "on the way `safe` is not shown",
    REST: "within its time `rest` is not shown",
    MOVES: "where it rests, and where SC then moves it, `safe` is not shown",
}
"""The parts that may fail."""
INCLUDED = '.h"\n'
WATCH = f"""
static struct {{
  double *rows, early, late, before[2], h;
  int count, width;
  bool by_sc, open, found, rests;
}} led;
static void led_flow(double h, bool found) {{
  led.h = h;
  led.found = found;
  led.open = true;
}}
static void led_safe(bool safe, const double *x, size_t stride, size_t n) {{
  double *row = led.rows + (size_t)led.count * (size_t)led.width;
  double h = led.open ? led.h : 0.0;
  row[0] = safe ? led.by_sc : {FAILED};
  row[1] = led.early;
  row[2] = led.late + h;
  for (size_t i = 0; i < 2 * n; i++) {{
    row[3 + i] = x[i / 2 * stride + i % 2];
  }}
  if (led.open && safe) {{
    led.before[0] = led.early;
    led.before[1] = led.late;
    led.early += h;
    led.late += h;
    led.count += led.count < {ROOM} - 1;
    led.open = false;
  }}
}}
static void led_rests(bool rests) {{
  led.rests = rests;
  led.open = false;
}}
/* SC begins anywhere in the step before; another part of the time goes on before that step */
static void led_settles(bool begins, const double *from) {{
  led.early = from[0];
  led.late = begins ? led.late : from[1];
  led.by_sc = begins;
}}
"""
ROWS = "&{0}->at[0].lo, sizeof {0}->at[0] / 8, sizeof {0}->at / sizeof {0}->at[0]"
BEGUN = "const double led_from[] = {{led.before[0], led.before[1]}};"
NOTED = {
    "flow": ("", "led_flow({3}, {5}->found);"),
    "safe": ("", f"led_safe(led_said, {ROWS});"),
    "rests": ("", "led_rests(led_said);"),
    "settles": (f"{BEGUN}\n  led_settles(true, led_from);", "led_settles(false, led_from);"),
}
"""The C notes before and after each watched function; its parameters go by number."""
CHECK = "tubes.soter"
"""The file name that functions of a check have in their places (`NAME` of verify/tubes)."""


@dataclass(frozen=True, eq=False)
class TubeLook:
    """The tube of a look: `boxes` (k, 3 + 2 n) as in a `LedPicture`; `failed`: the part not shown.

    SC may begin early or late, so boxes overlap in time. They hold all states until SC is at rest.
    """

    boxes: npt.NDArray[np.float64]
    failed: int


def _predicate_query(m: Module, name: str) -> str:
    """The C that asks whether a module's predicates call the estimate good."""
    ttf, safer = (f"{name}_{p}(state, &nan)" for p in ("ttf", "safer"))
    good = f"!{ttf}" if m.shield is None else f"judged ? !{ttf} : {safer}"
    return f"if (m == {m.index}) {{ good = {good}; }}"


class TubeLooks:
    """The compiled checks of a system's modules; `SoterError`, `OSError` if they do not compile."""

    def __init__(self, system: System, modules: Sequence[Module]) -> None:
        self.modules = modules
        arguments = {m.index: calls_in(m.symbol.safer)[0].arguments for m in self.modules}
        followed = {m: [a for a in of if not _is_of_map(a)] for m, of in arguments.items()}
        self.names = {m: tuple([leaf_path_name(a) for a in every]) for m, every in followed.items()}
        """The names of what a module's check reads, one for each state that it follows."""
        units = {m: [getattr(a.type, "unit", "") for a in of] for m, of in followed.items()}
        self.units = {m: tuple(of) for m, of in units.items()}
        self._late = {}
        builder = UnitBuilder(system, lower(system), None)
        unit = builder.run()
        self._dtype = state_dtype(unit.layout)
        source = _watch_functions(unit.source.replace(INCLUDED, f"{INCLUDED}{WATCH}", 1), builder)
        for m in self.modules:
            early = published_before(system, m.dm)
            self._late[m.index] = [t.name for t in system.topics if t.index not in early]
        cases = [_predicate_query(m, builder.module_names[m.index]) for m in self.modules]
        source += _query_function(unit.prefix, cases)
        loaded = ctypes.CDLL(str(library(replace(unit, source=source), "-O1")))
        self._ask = getattr(loaded, f"{unit.prefix}_led")

    def follow(
        self, module: int, before: bytes | None, at: bytes, *, judged: bool = False
    ) -> TubeLook:
        """The tube of the DM step in the instant that ended in the state `at`, after `before`.

        The check is asked whether the estimate is good with any command, or with those that were
        `judged`, in a module that judges them.
        """
        state = np.frombuffer(at, dtype=self._dtype).copy()
        for name in self._late[module] if before is not None else ():
            state["topics"][name] = np.frombuffer(before or b"", self._dtype)["topics"][name]
        rows = np.zeros((ROOM, 3 + 2 * len(self.names[module])))
        failed = ctypes.c_int()
        places = [ctypes.c_void_p(x.ctypes.data) for x in (state, rows)]
        count = self._ask(module, judged, *places, rows.shape[1], ctypes.byref(failed))
        boxes = rows[:count]
        if failed.value in TOLD:
            last = rows[count] if rows[count, 0] == FAILED else rows[count - 1]
            boxes = np.vstack([boxes, [FAILED, *last[1:]]])
        return TubeLook(boxes, failed.value)

    def failure_words(self, module: Module, led: TubeLook) -> str:
        """Says which part failed, and where; for a good look, when SC comes to rest."""
        until = float(led.boxes[:, 2].max(initial=0.0))
        if led.failed == GOOD:
            return f"SC would be at rest {until:.3g} s after the estimate at the latest"
        if led.failed == BOUNDED:
            return f"what may happen from {until:.3g} s after the estimate on is not bounded"
        rest = module.symbol.rest
        assert rest is not None
        read = tuple(_leaf_names(rest.condition if led.failed == REST else module.symbol.safe))
        _, start_s, end_s, *ends = led.boxes[-1].tolist()
        where = ", ".join(
            f"{name} in [{low:.4g}, {high:.4g}]"
            for name, low, high in zip(self.names[module.index], ends[::2], ends[1::2], strict=True)
            if any(f"{name}.".startswith(f"{path}.") for path in read)
        )
        return f"{TOLD[led.failed]}: {where} {start_s:.3g} to {end_s:.3g} s after the estimate"


def compile_looks(system: System) -> TubeLooks | None:
    """The looks of modules with `rest` and one plan; None if there are none, or no compiler."""
    modules = [m for m in _followed_modules(system) if m.computed]
    with contextlib.suppress(SoterError, OSError):
        return TubeLooks(system, modules) if modules else None
    return None


def _followed_modules(system: System) -> list[Module]:
    return [m for m in system.modules if m.symbol.rest is not None and m.plan is None]


def _is_of_map(e: typed.TypedExpr) -> bool:
    """Whether an expression is a number of a map, which no tube moves."""
    while isinstance(e, (typed.TypedField, typed.Index)):
        e = e.target
    assert isinstance(e, typed.TopicRead)
    return e.topic.static


def _leaf_names(e: object) -> Iterator[str]:
    """Yields the names of the topic leaves that an expression reads."""
    if isinstance(e, (typed.TopicRead, typed.TypedField, typed.Index)):
        with contextlib.suppress(AssertionError):
            yield leaf_path_name(e)
            return
    for x in children(e):
        yield from _leaf_names(x)


def _query_function(prefix: str, cases: Sequence[str]) -> str:
    """The C function that Python calls to follow a module's tube."""
    return f"""
int {prefix}_led(int m, bool judged, const void *state, double *rows, int width, int *failed) {{
  bool nan = false, good = false;
  (void)judged;
  led.rows = rows;
  led.width = width;
  led.count = 0;
  led.early = led.late = 0.0;
  led.by_sc = led.open = led.rests = false;
  led.found = true;
  {" ".join(cases)}
  int lost = led.open ? {SAFE} : led.rests ? {MOVES} : {REST};
  *failed = good ? {GOOD} : led.found ? lost : {BOUNDED};
  return led.count;
}}
"""


def _watch_functions(source: str, builder: UnitBuilder) -> str:
    for f in builder.core.functions:
        if f.span.source.name == CHECK and f.source_name in NOTED:
            source = _watch_function(source, builder.functions[f.name][0], *NOTED[f.source_name])
    return source


def _watch_function(source: str, name: str, before: str, after: str) -> str:
    """The C, in which a function also notes what it returned."""
    signature = rf"^SOTER_INLINE\s+([\w\s]+?)\s{name}\(([^)]*)\)\s*{{$"  # lines end where they like
    found = re.search(signature, source, re.MULTILINE)
    assert found is not None, name
    result, parameters = (" ".join(part.split()) for part in found.groups())
    names = re.findall(r"(\w+)(?:,|$)", parameters)
    call, back = f"{name}({', '.join(names)});", ""
    if result != "void":
        call, back = f"const {result} led_said = {call}", "return led_said;"
    lines = [line.format(*names) for line in (before, call, after, back)]
    body = "\n".join(f"  {line}" for line in lines if line)
    end = source.index("\n}\n", found.end()) + len("\n}\n")
    watched = f"SOTER_INLINE {result} {name}_noted({parameters}) {{\n{body}\n}}\n"
    return f"{source[:end]}{watched}#define {name} {name}_noted\n{source[end:]}"


Mode = Literal["SC", "AC"]


@dataclass(frozen=True)
class PredicateValues:
    """The facts of a DM step; `clean_needed`: how many clean outputs AC owes after a gate fault.

    `latched`: why its latch, if it has one, lets AC have no control; "": it does.
    """

    ttf: bool
    safer: bool
    stale: bool
    gate_fault: bool
    clean_needed: int = 0
    latched: str = ""

    def predicates(self) -> dict[str, bool]:
        """The facts by name, as logs and reports show them."""
        return {
            "ttf": self.ttf,
            "safer": self.safer,
            "stale": self.stale,
            "gate_fault": self.gate_fault,
        }


@dataclass(frozen=True)
class DecisionStepRecord:
    """A DM step: when, whose, the modes before and after, what it saw, and why in words."""

    time_ns: int
    module: str
    before: Mode
    after: Mode
    saw: PredicateValues
    reason: str
    margin_s: float
    """margin(M) right after it."""
    why: DecisionReason | None = None
    """The values behind it; None where nothing changed, and where the states are not kept."""
    reads: tuple[TopicRead, ...] = ()
    """What the step read, of a module with `rest`: the estimate from which SC was followed."""
    plan: str = ""
    """Of several plans the node that SC follows from this step on; "" where there is one."""

    @property
    def words(self) -> list[str]:
        """The reasons for the decision, one phrase each."""
        return [] if self.why is None else self.why.words(self.before, self.after)


def change_records(
    system: System, layout: StateLayout, changes: Sequence[ModeChange]
) -> list[DecisionStepRecord]:
    """The DM steps that changed a mode, in order of time, of a run's `changes`.

    For modules with `rest` a step that took control from AC has the part of the tube that failed.
    """
    explainer = Explainer(system, layout)
    found = [change_record(system, change, explainer) for change in changes]
    for k, part in _failed_parts(system, changes).items():
        why = found[k].why
        assert why is not None
        found[k] = replace(found[k], why=replace(why, led=part))
    return found


def _failed_parts(system: System, changes: Sequence[ModeChange]) -> dict[int, str]:
    """The part of the tube that failed, by number of the change; {} without a C compiler."""
    rests, every = [m.index for m in _followed_modules(system)], enumerate(changes)
    lost = [(k, c) for k, c in every if c.to != "AC" and c.ttf and c.states and c.module in rests]
    looks = compile_looks(system) if lost else None
    words_by_change = {}
    for k, c in lost if looks is not None else ():
        assert looks is not None
        assert c.states is not None
        led = looks.follow(c.module, *c.states, judged=True)
        if led.failed:
            words_by_change[k] = looks.failure_words(system.modules[c.module], led)
    return words_by_change


def change_record(
    system: System, change: ModeChange, explainer: Explainer | None = None
) -> DecisionStepRecord:
    """The record of a change of mode with its reason; with an `explainer` also the values."""
    module = system.modules[change.module]
    saw = PredicateValues(change.ttf, change.safer, change.stale, change.gate_fault)
    after: Mode = "AC" if change.to == "AC" else "SC"
    before: Mode = "SC" if after == "AC" else "AC"
    why = None
    if explainer is not None and change.states is not None:
        why = explainer.explain(change.module, *change.states)
    text = decision_reason(before, after, saw)
    margin_s = _margin_s(module, after, saw)
    return DecisionStepRecord(
        change.time_ns, module.name, before, after, saw, text, margin_s=margin_s, why=why
    )


def decision_steps(
    system: System,
    states: npt.NDArray[Any],
    earlier: Any = None,  # noqa: ANN401 - a state
    explainer: Explainer | None = None,
) -> Iterator[DecisionStepRecord]:
    """Yields every DM step of consecutive states, (n,), in order of time, then of modules.

    `earlier`: the state before the first, None at the start of a run. With an `explainer` a step
    that saw or did something else than the one before has the values, and one of a module with
    `rest` what it read.
    """
    due = decided_rows(system, states)
    modules = states["modules"]
    times_ns = states["header"]["ct"]
    for row in np.flatnonzero(due.any(axis=1)):
        before = states[row - 1] if row else earlier
        for module in system.modules:
            if due[row, module.index]:
                seen = None if before is None else before["modules"]
                waits = _latch_wait(module, states[row])
                decision = _step_record(modules[row], seen, module, int(times_ns[row]), waits)
                raw = None if before is None else before.tobytes()
                if explainer is not None and _has_changed(modules[row], seen, module.index):
                    why = explainer.explain(module.index, raw, states[row].tobytes())
                    decision = replace(decision, why=why)
                if explainer is not None and module.symbol.rest is not None:
                    read = explainer.reads(module.index, raw, states[row].tobytes())
                    decision = replace(decision, reads=read)
                if module.plan is not None:
                    number = int(states["topics"][system.topics[module.plan].name][row])
                    decision = replace(decision, plan=module.symbol.plans[number].name)
                yield decision


def margins_s(system: System, module: Module, states: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
    """margin(M) in s after every instant, (n,); `states`, (n,), from the start of the run."""
    now, of = states["header"]["ct"], states["modules"][:, module.index]
    due = decided_rows(system, states)[:, module.index]
    last = np.maximum.accumulate(np.where(due, now, np.iinfo(np.int64).min // 2))
    unsafe = (of["ttf"] != 0) | (of["stale"] != 0) | (of["saw_gate_fault"] != 0)
    looks = np.where(unsafe, 0, np.where(of["safer"] != 0, module.looks, 1))
    left_ns = looks * module.period_ns - module.late_ns - (now - last)
    margin_s: npt.NDArray[np.float64] = np.where(of["mode"] != 0, np.maximum(left_ns, 0), 0) / 1e9
    return margin_s


def latch_rows(module: Module, states: npt.NDArray[Any]) -> npt.NDArray[np.bool_]:
    """Whether a module's latch keeps AC from control, (n,), after each of `states`, (n,)."""
    in_sc = states["modules"]["mode"][:, module.index] == 0
    if module.latch is None:
        return np.zeros_like(in_sc)
    held = states["topics"][f"{module.name}.latch"]
    waits: npt.NDArray[np.bool_] = held != (
        OPEN if module.acknowledgement is None else ACKNOWLEDGED
    )
    both: npt.NDArray[np.bool_] = in_sc & waits
    return both


def _latch_wait(module: Module, state: Any) -> str:  # noqa: ANN401 - a state
    """What a module's latch waits for after an instant; "" if AC may have control."""
    if module.latch is None or not latch_rows(module, state.reshape(1))[0]:
        return ""
    if not module.symbol.acknowledgements:
        return "latched: it returns never"
    name = module.symbol.acknowledgements[0].name
    released = int(state["topics"][f"{module.name}.latch"]) == READY
    return f"latched: waits for {name} to be {'' if released else 'released and '}pressed"


def _step_record(
    modules: Any,  # noqa: ANN401 - rows of modules
    before: Any,  # noqa: ANN401
    module: Module,
    time_ns: int,
    waits: str,
) -> DecisionStepRecord:
    """The record of a DM step; AC's owed outputs are those before it, as AC steps after the DM."""
    now = modules[module.index]
    earlier = None if before is None else before[module.index]
    was_ac = module.forced == "ac" if earlier is None else bool(earlier["mode"])
    saw = PredicateValues(
        bool(now["ttf"]),
        bool(now["safer"]),
        bool(now["stale"]),
        bool(now["saw_gate_fault"]),
        0 if earlier is None else int(earlier["clean_needed"]),
        waits,
    )
    was: Mode = "AC" if was_ac else "SC"
    after: Mode = "AC" if now["mode"] else "SC"
    why = "the system forces this mode" if module.forced else decision_reason(was, after, saw)
    return DecisionStepRecord(
        time_ns, module.name, was, after, saw, why, _margin_s(module, after, saw)
    )


def _margin_s(module: Module, after: Mode, saw: PredicateValues) -> float:
    """For how many seconds AC surely keeps control from this step on."""
    unsafe = saw.ttf or saw.stale or saw.gate_fault
    looks = module.looks_left(unsafe=unsafe, safer=saw.safer)
    return module.margin_ns(looks, 0) / 1e9 if after == "AC" else 0.0


def _has_changed(now: Any, before: Any, module: int) -> bool:  # noqa: ANN401 - rows of modules
    """Whether a step saw or did something else than the step before."""
    facts = ["mode", "ttf", "safer", "stale", "saw_gate_fault"]
    return before is None or bool(now[module][facts] != before[module][facts])


def decision_reason(before: Mode, after: Mode, saw: PredicateValues) -> str:
    """Says why a DM step decided as it did; "" if there is nothing to say."""
    if after == "SC":
        return " and ".join(_objections(saw, staying=before == "SC"))
    return "safer: far enough inside φ_safe" if before == "SC" else ""


def _objections(saw: PredicateValues, *, staying: bool) -> Iterator[str]:
    """Yields the reasons against AC's control, in words."""
    if saw.ttf and not staying:
        yield "ttf: must hold wherever φ_safe could be left within 2Δ (`soter verify` checks that)"
    if saw.stale:
        yield "stale: an input is older than its max_age, or inputs are of different instants"
    if saw.gate_fault and not staying:
        yield "gate fault: an output of AC was refused"
    if staying and not saw.safer:
        yield "not safer yet"
    if staying and saw.clean_needed:
        yield f"AC owes {saw.clean_needed} clean outputs"
    if staying and saw.latched:
        yield saw.latched
