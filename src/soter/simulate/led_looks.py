"""Where SC would lead from what a decision module with `rest` read: the check itself, watched.

Purpose: `LedLooks`: the compiled predicates of a system, asked again of a state, with a look at
each step of the tube that they follow; `Led`: boxes of states, and the part that was not shown.
The arithmetic is that of the C that flies: it is compiled once more with a note behind each call
of `flow`, `safe`, `rests` and `settles` (`verify/tubes/*.soter`).
Non-goals: deciding, drawing (`report/run/led_picture.py`).
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
from soter.language.model import typed
from soter.language.model.tree_walk import calls_in, children
from soter.native.build import library
from soter.simulate.explain_decision import path_of, published_before

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

    from soter.language.model.system import Module, System

ROOM = 8192
"""Steps of one look that are kept."""
SAFE, REST, MOVES, BOUNDED = "safe", "rest", "moves", "bounded"
TOLD = {
    SAFE: "on the way `safe` is not shown",
    REST: "within its time `rest` is not shown",
    MOVES: "where it rests, and SC then moves it to, `safe` is not shown",
}
"""The parts that may fail."""
WATCH = """
static struct {
  double *rows, early, late, before[2], h;
  int count, room, width;
  bool sc, open, found, rests;
} led;
static void led_row(int at, bool by_sc, double to, const double *x, size_t stride, size_t n) {
  double *row = led.rows + (size_t)at * (size_t)led.width;
  row[0] = by_sc;
  row[1] = led.early;
  row[2] = to;
  for (size_t i = 0; i < n; i++) {
    row[3 + 2 * i] = x[i * stride];
    row[4 + 2 * i] = x[i * stride + 1];
  }
}
static void led_flow(double h, bool found, const double *x, size_t stride, size_t n) {
  led.h = h;
  led.open = led.count < led.room;
  led.found = found;
  led_row(led.count, led.sc, led.late + h, x, stride, n);
}
static void led_safe(bool safe) {
  if (led.open && safe) {
    led.before[0] = led.early;
    led.before[1] = led.late;
    led.early += led.h;
    led.late += led.h;
    led.count++;
    led.open = false;
  }
}
static void led_rests(bool rests, const double *x, size_t stride, size_t n) {
  led.open = false;
  led.rests = rests;
  led_row(led.room, true, led.late, x, stride, n);
}
/* SC begins to act anywhere in the step before; another part of the time goes on before it */
static void led_begins(double *from) {
  from[0] = led.early = led.before[0];
  from[1] = led.before[1];
  led.sc = true;
}
static void led_ends(const double *from) {
  led.early = from[0];
  led.late = from[1];
  led.sc = false;
}
"""
BEFORE = {"settles": ("double led_from[2];", "led_begins(led_from);")}
AFTER = {
    "flow": "led_flow({3}, {5}->found, {rows}, {sizes});",
    "safe": "led_safe(led_said);",
    "rests": "led_rests(led_said, {rows}, {sizes});",
    "settles": "led_ends(led_from);",
}
"""What is noted around each function of the check; its parameters by number."""
ASKED = """
int {prefix}_led(int module, bool judged, const void *state, double *rows, int room, int width,
    bool *said) {{
  bool nan_seen = false;
  (void)judged;
  led.rows = rows;
  led.room = room;
  led.width = width;
  led.count = 0;
  led.early = led.late = 0.0;
  led.sc = led.open = led.rests = false;
  led.found = true;
  switch (module) {{
{cases}
  }}
  said[1] = led.open;
  said[2] = led.found;
  said[3] = led.rests;
  return led.count;
}}
"""
INCLUDED = '.h"\n'
CHECK = "tubes.soter"
"""Where functions of a check say that they stand."""


@dataclass(frozen=True)
class LedBox:
    """States between `from_s` and `to_s`, counted from the estimate; `by_sc`: SC's outputs act."""

    by_sc: bool
    from_s: float
    to_s: float
    low: tuple[float, ...]
    high: tuple[float, ...]


@dataclass(frozen=True)
class Led:
    """A look: `boxes`, in time; `failed`: the part that is not shown, "" where it is good; where.

    SC may begin early or late, so boxes overlap in time. No box is of later than its rest.
    """

    boxes: tuple[LedBox, ...]
    failed: str = ""
    at: LedBox | None = None


class LedLooks:
    """The check of each module with `rest` of a system; SoterError where it cannot be compiled."""

    def __init__(self, system: System) -> None:
        self.modules = followed(system)
        read = {m.index: calls_in(m.symbol.safer)[0].arguments for m in self.modules}
        self.names = {m: [path_of(a) for a in every] for m, every in read.items()}
        """What the check of a module reads of each state that it follows."""
        self.units = {m: [getattr(a.type, "unit", "") for a in every] for m, every in read.items()}
        self._late = {
            m.index: [
                t.name for t in system.topics if t.index not in published_before(system, m.dm)
            ]
            for m in self.modules
        }
        builder = UnitBuilder(system, lower(system), None)
        unit = builder.run()
        self._dtype = state_dtype(system, unit.layout)
        source = unit.source
        for f in builder.core.functions:
            if f.span.source.name == CHECK and f.source_name in AFTER:
                source = _watched(source, builder.functions[f.name][0], f.source_name)
        cases = []
        for m in self.modules:
            name = builder.module_names[m.index]
            ttf, safer = (f"{name}_{p}(state, &nan_seen)" for p in ("ttf", "safer"))
            good = f"!{ttf}" if m.shield is None else f"judged ? !{ttf} : {safer}"
            cases.append(f"    case {m.index}: said[0] = {good}; break;")
        source = source.replace(INCLUDED, f"{INCLUDED}{WATCH}", 1)
        source += ASKED.format(prefix=unit.prefix, cases="\n".join(cases))
        held = ctypes.CDLL(str(library(replace(unit, source=source), "-O1")))
        self._ask = getattr(held, f"{unit.prefix}_led")

    def of(self, module: int, before: bytes | None, at: bytes, *, judged: bool = False) -> Led:
        """Of the DM step in the instant that ended in the state `at`; `before`: the one before it.

        What is asked: whether the estimate is good with any command, or with those that were
        `judged`, of a module that does so.
        """
        state = np.frombuffer(at, dtype=self._dtype).copy()
        if before is not None:
            for name in self._late[module]:
                state["topics"][name] = np.frombuffer(before, dtype=self._dtype)["topics"][name]
        rows = np.zeros((ROOM + 1, 3 + 2 * len(self.names[module])))
        said = (ctypes.c_bool * 4)()
        places = [x.ctypes.data_as(ctypes.c_void_p) for x in (state, rows)]
        count = self._ask(module, judged, *places, ROOM, rows.shape[1], said)
        good, fails, found, rests = said
        boxes = tuple(_box(row) for row in rows[:count])
        if good:
            return Led(boxes)
        if not found:
            return Led(boxes, BOUNDED)
        if fails:
            return Led(boxes, SAFE, _box(rows[count]))
        return Led(boxes, MOVES if rests else REST, _box(rows[ROOM]))

    def why_not(self, module: Module, led: Led) -> str:
        """The part that failed, and where; "" of a good look."""
        if not led.failed:
            return ""
        if led.at is None:
            after = led.boxes[-1].to_s if led.boxes else 0.0
            return f"what may happen from {after:.3g} s after the estimate on is not bounded"
        rest = module.symbol.rest
        assert rest is not None
        about = rest.condition if led.failed == REST else module.symbol.safe
        read = tuple(_paths(about))
        names = self.names[module.index]
        ends = [
            f"{name} in [{low:.4g}, {high:.4g}]"
            for name, low, high in zip(names, led.at.low, led.at.high, strict=True)
            if any(f"{name}.".startswith(f"{path}.") for path in read)
        ]
        where = f"{', '.join(ends)} {led.at.from_s:.3g} to {led.at.to_s:.3g} s after the estimate"
        return f"{TOLD[led.failed]}: {where}"


def followed(system: System) -> list[Module]:
    """Its modules whose decision modules follow SC."""
    return [m for m in system.modules if m.symbol.rest is not None and m.computed]


def _paths(e: object) -> Iterator[str]:
    """What an expression reads of topics."""
    if isinstance(e, (typed.TopicRead, typed.TypedField, typed.Index)):
        with contextlib.suppress(AssertionError):
            yield path_of(e)
            return
    for x in children(e):
        yield from _paths(x)


def _watched(source: str, name: str, what: str) -> str:
    """The C in which a function is called through one that tells what it gave."""
    found = re.search(rf"^SOTER_INLINE ([\w ]+) {name}\(([^)]*)\) {{$", source, re.MULTILINE)
    assert found is not None, name
    result, given = found[1], " ".join(found[2].split())
    names = re.findall(r"(\w+)(?:,|$)", given)
    rows = f"{names[5]}->way.at" if what == "flow" else f"{names[0]}->at"
    told = {
        "rows": f"(const double *)(const void *){rows} + 2",
        "sizes": f"sizeof {rows}[0] / sizeof(double), sizeof {rows} / sizeof {rows}[0]",
    }
    call = f"{name}({', '.join(names)})"
    lines = [
        *BEFORE.get(what, ()),
        f"{call};" if result == "void" else f"const {result} led_said = {call};",
        AFTER[what].format(*names, **told),
        *(() if result == "void" else ("return led_said;",)),
    ]
    body = "\n".join(f"  {line}" for line in lines)
    end = source.index("\n}\n", found.end()) + len("\n}\n")
    watched = f"SOTER_INLINE {result} {name}_watched({given}) {{\n{body}\n}}\n"
    return f"{source[:end]}{watched}#define {name} {name}_watched\n{source[end:]}"


def _box(row: npt.NDArray[np.float64]) -> LedBox:
    by_sc, from_s, to_s, *ends = row.tolist()
    return LedBox(bool(by_sc), from_s, to_s, tuple(ends[::2]), tuple(ends[1::2]))
