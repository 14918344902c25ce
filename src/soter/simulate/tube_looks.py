"""Computes the tube through which SC would have led from the estimate of a decision module.

Purpose: `TubeLooks` compiles the predicates of a system and evaluates them again on a state. Each
call of `flow`, `safe`, `rests` and `settles` (`verify/tubes/*.soter`) is noted: these notes are the
boxes of the tube, and the part that is not shown. All arithmetic is that of the deployed C.
Non-goals: what was decided (`decisions.py`), drawing (`report/run/where_sc_leads.py`).

Each of these functions gets a wrapper in the generated C. A macro replaces the function's name, so
that the predicates call the wrapper. The C of the notes (`WATCH`) follows the unit's own header.
"""

from __future__ import annotations

import contextlib
import ctypes
import re
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from soter.codegen.unit import UnitBuilder
from soter.core.layout import state_dtype
from soter.core.steps import lower
from soter.diagnostics.diagnostic import SoterError
from soter.language.model import typed
from soter.language.model.tree_walk import calls_in, children
from soter.native.shared_library import library
from soter.report.run.where_sc_leads import FAILED
from soter.simulate.explain_decision import early_topics, leaf_path_name

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import numpy.typing as npt

    from soter.language.model.system import Module, System

ROOM = 8192
"""The most boxes of one tube that are kept."""
GOOD, SAFE, REST, MOVES, BOUNDED = range(5)
FAILURES = {
    SAFE: "on the way `safe` is not shown",
    REST: "within its time `rest` is not shown",
    MOVES: "where it rests, and where SC then moves it, `safe` is not shown",
}
"""The parts of the check that may fail, in words."""
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
"""The C before and after a call of each watched function; {n} is its parameter n."""
CHECK = "tubes.soter"
"""The file name in the source places of a check's functions (`NAME` of verify/tubes)."""


@dataclass(frozen=True, eq=False)
class TubeLook:
    """The tube of a DM step: `boxes` (k, 3 + 2 n) as in a `LedPicture`; `failed`: the failed part.

    SC may begin early or late, so boxes overlap in time. They hold all states until SC is at rest.
    """

    boxes: npt.NDArray[np.float64]
    failed: int


def _predicate_query(m: Module, name: str) -> str:
    """The C that evaluates whether a module's predicates accept the estimate."""
    ttf, safer = (f"{name}_{p}(state, &nan)" for p in ("ttf", "safer"))
    good = f"!{ttf}" if m.shield is None else f"judged ? !{ttf} : {safer}"
    return f"if (m == {m.index}) {{ good = {good}; }}"


class TubeLooks:
    """The compiled checks of a system's modules; raises `SoterError`, `OSError` if that fails."""

    def __init__(self, system: System, modules: Sequence[Module]) -> None:
        self.modules = modules
        arguments = {m.index: calls_in(m.symbol.safer)[0].arguments for m in self.modules}
        followed = {m: [a for a in of if not _reads_map(a)] for m, of in arguments.items()}
        self.names = {m: tuple([leaf_path_name(a) for a in every]) for m, every in followed.items()}
        """The names of the leaves that a module's check reads, one for each followed state."""
        units = {m: [getattr(a.type, "unit", "") for a in of] for m, of in followed.items()}
        self.units = {m: tuple(of) for m, of in units.items()}
        self._late = {}
        builder = UnitBuilder(system, lower(system), None)
        unit = builder.build_unit()
        self._dtype = state_dtype(unit.layout)
        source = _with_watched_functions(
            unit.source.replace(INCLUDED, f"{INCLUDED}{WATCH}", 1), builder
        )
        for m in self.modules:
            early = early_topics(system, m.dm)
            self._late[m.index] = [t.name for t in system.topics if t.index not in early]
        cases = [_predicate_query(m, builder.module_names[m.index]) for m in self.modules]
        source += _query_function(unit.prefix, cases)
        loaded = ctypes.CDLL(str(library(replace(unit, source=source), "-O1")))
        self._ask = getattr(loaded, f"{unit.prefix}_led")

    def follow_tube(
        self, module: int, before: bytes | None, at: bytes, *, judged: bool = False
    ) -> TubeLook:
        """Computes the tube of the DM step in the instant that led from state `before` to `at`.

        The check covers any command. In a module that judges commands, `judged` limits it to the
        judged ones.
        """
        state = np.frombuffer(at, dtype=self._dtype).copy()
        for name in self._late[module] if before is not None else ():
            state["topics"][name] = np.frombuffer(before or b"", self._dtype)["topics"][name]
        rows = np.zeros((ROOM, 3 + 2 * len(self.names[module])))
        failed = ctypes.c_int()
        places = [ctypes.c_void_p(x.ctypes.data) for x in (state, rows)]
        count = self._ask(module, judged, *places, rows.shape[1], ctypes.byref(failed))
        boxes = rows[:count]
        if failed.value in FAILURES:
            last = rows[count] if rows[count, 0] == FAILED else rows[count - 1]
            boxes = np.vstack([boxes, [FAILED, *last[1:]]])
        return TubeLook(boxes, failed.value)

    def failure_words(self, module: Module, led: TubeLook) -> str:
        """Says which part of a tube failed and where, or else when SC comes to rest."""
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
        return f"{FAILURES[led.failed]}: {where} {start_s:.3g} to {end_s:.3g} s after the estimate"


def compile_looks(system: System) -> TubeLooks | None:
    """Compiles the checks of modules with `rest` and one plan; None if that is impossible."""
    modules = [m for m in followed_modules(system) if m.computed]
    with contextlib.suppress(SoterError, OSError):
        return TubeLooks(system, modules) if modules else None
    return None


def followed_modules(system: System) -> list[Module]:
    """The modules whose DM follows SC through a tube: those with `rest` and one plan."""
    return [m for m in system.modules if m.symbol.rest is not None and m.plan is None]


def _reads_map(e: typed.TypedExpr) -> bool:
    """Whether an expression reads a number of a map (a static topic), which no tube moves."""
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
    """The C function that lets Python follow a module's tube."""
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


def _with_watched_functions(source: str, builder: UnitBuilder) -> str:
    for f in builder.core.functions:
        if f.span.source.name == CHECK and f.source_name in NOTED:
            source = _with_watched_function(
                source, builder.functions[f.name][0], *NOTED[f.source_name]
            )
    return source


def _with_watched_function(source: str, name: str, before: str, after: str) -> str:
    """A copy of the C source in which one function also notes its calls and results."""
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
