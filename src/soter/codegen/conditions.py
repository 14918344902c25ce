"""The conditions of generated C: the line of each, and what runs of that C show of it.

Purpose: a *decision* is a whole truth value that the C computes: what an `if`, `? :` or guard asks,
or what a comparison, `!`, `&&` or `||` gives; its *conditions* are what `&&`, `||` and `!` join.
`conditions_of` finds them with their lines. Inside `watching` every unit is generated with counters
of its own; `why_unshown` reads what its runs did. A condition is shown as in the modified
condition/decision coverage (MC/DC) of clang: by two evaluations whose outcomes differ, and of the
conditions that both evaluated this one alone differs.
Non-goals: the C of the run-time and of users (`bench/c_code/c_coverage.py`); bounds of loops, which
the program fixes; C with counters in anything that ships.
"""

from __future__ import annotations

import ctypes
import re
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from itertools import combinations
from typing import TYPE_CHECKING, Any

from soter.codegen import c_tree as c
from soter.codegen.c_printer import COMPARISONS, expr_text, item_lines, print_file
from soter.language.syntax.node import field_values

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    Decision = tuple[str, c.CExpr]
    Vector = tuple[int, int, bool]
    """Bits of the conditions that were evaluated, bits of those that were true, the outcome."""


LOGIC = {"&&", "||"}
CONDITIONS_MAX, VECTORS_MAX = 31, 64
"""The most conditions of a decision, and different evaluations; beyond these nothing is shown."""
_Vectors = ctypes.c_uint64 * VECTORS_MAX
COUNTERS = """
uint64_t traced_vectors[{n}][{most}];
static bool soter_condition(uint64_t *seen, unsigned i, bool value) {{
  *seen |= (UINT64_C(1) << i) | ((uint64_t)value << (31U + i));
  return value;
}}
static bool soter_outcome(uint64_t *seen, unsigned d, bool value) {{
  const uint64_t made = *seen | ((uint64_t)value << 62U) | (UINT64_C(1) << 63U);
  unsigned k = 0;
  *seen = 0;
  while (k < {most}U && traced_vectors[d][k] != 0U && traced_vectors[d][k] != made) {{
    k++;
  }}
  if (k < {most}U) {{
    traced_vectors[d][k] = made;
  }}
  return value;
}}
"""
_WATCHED: ContextVar[list[tuple[tuple[Decision, ...], Path]] | None] = ContextVar(
    "watched", default=None
)


@dataclass(frozen=True)
class Condition:
    """A condition: its function, its line in the C, and the texts of decision and condition.

    `of`: the comment of the function, with the line in the program; `key`: equal in all units.
    """

    function: str
    of: str
    line: int
    decision: str
    text: str
    key: tuple[str, str, int]


def functions_of(file: c.CFile) -> dict[str, c.FunctionDef]:
    """The functions that a file defines, by name."""
    return {f.name: f for f in file.items if isinstance(f, c.FunctionDef) and f.body is not None}


def functions_called(functions: dict[str, c.FunctionDef], roots: Sequence[str]) -> set[str]:
    """The functions `roots`, and all functions that they call, directly or through others."""
    found: set[str] = set()
    left = [name for name in roots if name in functions]
    while left:
        if (name := left.pop()) not in found:
            found.add(name)
            named = {
                n.function if isinstance(n, c.CallExpr) else n.text
                for n in _nodes_below(functions[name].body)
                if isinstance(n, (c.CallExpr, c.Name))
            }
            left += sorted(named & functions.keys())
    return found


def _nodes_below(root: object) -> Iterator[object]:
    yield root
    below = root if isinstance(root, tuple) else ()
    if isinstance(root, (c.CExpr, c.CStmt)):
        below = field_values(root)
    for part in below:
        yield from _nodes_below(part)


def conditions_of(file: c.CFile, text: str) -> list[Condition]:
    """The conditions of a file in the order of their lines; `text`: the printed file."""
    found: list[Condition] = []
    for f in functions_of(file).values():
        begin = at = text.index("\n".join(item_lines(f)))
        counted: dict[str, int] = {}
        for _, decision in _decisions_in(f):
            shown = expr_text(decision)
            place = re.compile(r"\s+".join(map(re.escape, shown.split()))).search(text, at)
            at = place.start() if place else begin
            line = text.count("\n", 0, at) + 1
            at += 1
            number = counted[shown] = counted.get(shown, -1) + 1
            for k, condition in enumerate(_conditions_in(decision)):
                key = (f.name, f"{number} {shown}", k)
                found.append(Condition(f.name, f.doc, line, shown, expr_text(condition), key))
    return sorted(found, key=lambda x: x.line)


def _decisions_in(f: c.FunctionDef) -> list[Decision]:
    made: list[Decision] = []
    _Counting(f.name, made).with_counters(f.body)
    return made


def _is_logic(e: object) -> bool:
    return (isinstance(e, c.Binary) and e.op in LOGIC) or (isinstance(e, c.Unary) and e.op == "!")


def _conditions_in(e: c.CExpr) -> Iterator[c.CExpr]:
    if isinstance(e, c.Binary) and e.op in LOGIC:
        yield from _conditions_in(e.left)
        yield from _conditions_in(e.right)
    elif isinstance(e, c.Unary) and e.op == "!":
        yield from _conditions_in(e.operand)
    else:
        yield e


class _Counting:
    """Adds to a function the C that counts its decisions and conditions."""

    def __init__(self, function: str, made: list[Decision]) -> None:
        self.function, self.made, self.first = function, made, len(made)

    def watched(self, f: c.FunctionDef) -> c.FunctionDef:
        """The function with local counters, as several threads may run it."""
        body = self.with_counters(f.body)
        numbers = range(self.first, len(self.made))
        counters = tuple(c.Declare("uint64_t", _counter_name(k), c.Number("0U")) for k in numbers)
        return replace(f, body=(*counters, *body))

    def with_counters(self, node: Any) -> Any:  # noqa: ANN401 - any piece of C
        """The same piece of C, with added calls that count its decisions."""
        if isinstance(node, tuple):
            return tuple(map(self.with_counters, node))
        if isinstance(node, c.IfStmt):
            asked = self.counted_decision(node.condition)
            return c.IfStmt(
                asked, self.with_counters(node.then), self.with_counters(node.otherwise)
            )
        if isinstance(node, c.Ternary):
            asked = self.counted_decision(node.condition)
            return c.Ternary(
                asked, self.with_counters(node.then), self.with_counters(node.otherwise)
            )
        if _is_logic(node) or (isinstance(node, c.Binary) and node.op in COMPARISONS):
            return self.counted_decision(node)
        if isinstance(node, (c.CExpr, c.CStmt)) and not isinstance(node, c.Name):
            return type(node)(*map(self.with_counters, field_values(node)))
        return node

    def counted_decision(self, e: c.CExpr) -> c.CExpr:
        """The decision with added calls, which count it and its conditions."""
        number = len(self.made)
        self.made.append((self.function, e))
        atoms = list(_conditions_in(e))
        if len(atoms) > CONDITIONS_MAX:
            return e
        seen, at = c.Unary("&", c.Name(_counter_name(number))), iter(range(len(atoms)))

        def counted(x: c.CExpr) -> c.CExpr:
            if isinstance(x, c.Binary) and x.op in LOGIC:
                return c.Binary(x.op, counted(x.left), counted(x.right))
            if isinstance(x, c.Unary) and x.op == "!":
                return c.Unary("!", counted(x.operand))
            number_of_condition = c.Number(f"{next(at)}U")
            return c.CallExpr(
                "soter_condition", (seen, number_of_condition, self._with_counts_inside(x))
            )

        return c.CallExpr("soter_outcome", (seen, c.Number(f"{number}U"), counted(e)))

    def _with_counts_inside(self, x: c.CExpr) -> c.CExpr:
        """The condition, with calls that count the decisions inside it, such as in an argument."""
        if isinstance(x, c.Binary):
            return c.Binary(x.op, self.with_counters(x.left), self.with_counters(x.right))
        made: c.CExpr = self.with_counters(x)
        return made


def _counter_name(number: int) -> str:
    return f"soter_seen_{number}"


# ---------------------------------------------------------------- while programs run


@contextmanager
def watching() -> Iterator[Callable[[], dict[tuple[str, str], set[Vector]]]]:
    """Counts conditions of C generated in this block; the function gives all evaluations so far."""
    libraries: list[tuple[tuple[Decision, ...], Path]] = []
    token = _WATCHED.set(libraries)
    try:
        yield lambda: _shown_evaluations(libraries)
    finally:
        _WATCHED.reset(token)


def print_with_counters(file: c.CFile, include: str) -> tuple[str, tuple[Decision, ...]]:
    """The printed file with counters, and the decisions counted; no counters outside `watching`."""
    if _WATCHED.get() is None:
        return print_file(file), ()
    made: list[Decision] = []
    items = tuple(
        _Counting(x.name, made).watched(x) if isinstance(x, c.FunctionDef) and x.body else x
        for x in file.items
    )
    text = COUNTERS.format(n=max(len(made), 1), most=VECTORS_MAX)
    return print_file(c.CFile(items)).replace(include, include + text, 1), tuple(made)


def note_library(decisions: tuple[Decision, ...], path: Path) -> None:
    """Notes the library that counts these decisions, and clears its counters.

    If a process loads a library twice, both share one copy of the counters.
    """
    libraries = _WATCHED.get()
    if libraries is None or not decisions or any(path == known for _, known in libraries):
        return
    ctypes.memset(_counters(decisions, path), 0, ctypes.sizeof(_Vectors) * len(decisions))
    libraries.append((decisions, path))


def _counters(decisions: tuple[Decision, ...], path: Path) -> ctypes.Array[Any]:
    """The counters of a library, a row for each decision."""
    return (_Vectors * len(decisions)).in_dll(ctypes.CDLL(str(path)), "traced_vectors")


def _shown_evaluations(
    libraries: Sequence[tuple[tuple[Decision, ...], Path]],
) -> dict[tuple[str, str], set[Vector]]:
    """The evaluations of each decision in all these libraries, by function and numbered text."""
    found: dict[tuple[str, str], set[Vector]] = {}
    for decisions, path in libraries:
        rows = _counters(decisions, path)
        counts: dict[tuple[str, str], int] = {}
        for (function, decision), row in zip(decisions, rows, strict=True):
            text = expr_text(decision)
            number = counts[function, text] = counts.get((function, text), -1) + 1
            low = (1 << CONDITIONS_MAX) - 1
            vectors = {(v & low, v >> 31 & low, bool(v >> 62 & 1)) for v in row if v}
            found.setdefault((function, f"{number} {text}"), set()).update(vectors)
    return found


def why_unshown(vectors: set[Vector], condition: int) -> str:
    """Why runs do not show that a condition decides alone (MC/DC), in words; "" if they do."""
    bit = 1 << condition
    values = {bool(true & bit) for seen, true, _ in vectors if seen & bit}
    if len(values) < 2:
        return f"never {'false' if True in values else 'true'}" if values else "never evaluated"
    for (seen, true, outcome), (others, also, other) in combinations(vectors, 2):
        if outcome != other and (true ^ also) & seen & others == bit:
            return ""
    return "true and false, but it never decided alone"
