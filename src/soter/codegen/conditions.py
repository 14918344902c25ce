"""The conditions of generated C: where each stands, and what runs of that C show of it.

Purpose: a *decision* is a whole truth value that the C computes: what an `if`, `? :` or guard asks,
or what a comparison, `!`, `&&` or `||` gives; its *conditions* are what `&&`, `||` and `!` join.
`conditions_of` finds them with their lines. Inside `watched` every unit is generated with counters
of its own; `shown` reads what its runs did. Modified condition/decision coverage (MC/DC) as clang
counts it: two evaluations whose outcomes differ, and of the conditions that both evaluated this one
alone differs.
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
from soter.codegen.c_printer import COMPARISONS, expr, print_file, top
from soter.language.syntax.node import parts

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    Decision = tuple[str, c.CExpr]
    Vector = tuple[int, int, bool]
    """Bits of the conditions that were evaluated, bits of those that were true, the outcome."""


LOGIC = {"&&", "||"}
CONDITIONS_MAX, VECTORS_MAX = 31, 64
"""Conditions of a decision, and evaluations that differ; of what is beyond nothing is shown."""
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
    """A condition: its function, the line of the C, and the texts of decision and condition.

    `of`: what the function is, with its line of the program; `key`: the same in every unit of it.
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


def reached(functions: dict[str, c.FunctionDef], roots: Sequence[str]) -> set[str]:
    """The functions that these call, over others, too, and themselves."""
    found: set[str] = set()
    left = [name for name in roots if name in functions]
    while left:
        if (name := left.pop()) not in found:
            found.add(name)
            named = {
                n.function if isinstance(n, c.CallExpr) else n.text
                for n in _below(functions[name].body)
                if isinstance(n, (c.CallExpr, c.Name))
            }
            left += sorted(named & functions.keys())
    return found


def _below(root: object) -> Iterator[object]:
    yield root
    below = root if isinstance(root, tuple) else ()
    if isinstance(root, (c.CExpr, c.CStmt)):
        below = parts(root)
    for part in below:
        yield from _below(part)


def conditions_of(file: c.CFile, text: str) -> list[Condition]:
    """The conditions of a file in the order of their lines; `text`: as it is printed."""
    found: list[Condition] = []
    for f in functions_of(file).values():
        begin = at = text.index("\n".join(top(f)))
        counted: dict[str, int] = {}
        for _, decision in _decisions(f):
            shown = expr(decision)
            place = re.compile(r"\s+".join(map(re.escape, shown.split()))).search(text, at)
            at = place.start() if place else begin
            line = text.count("\n", 0, at) + 1
            at += 1
            number = counted[shown] = counted.get(shown, -1) + 1
            for k, condition in enumerate(_atoms(decision)):
                key = (f.name, f"{number} {shown}", k)
                found.append(Condition(f.name, f.doc, line, shown, expr(condition), key))
    return sorted(found, key=lambda x: x.line)


def _decisions(f: c.FunctionDef) -> list[Decision]:
    made: list[Decision] = []
    _Counting(f.name, made).rewritten(f.body)
    return made


def _is_logic(e: object) -> bool:
    return (isinstance(e, c.Binary) and e.op in LOGIC) or (isinstance(e, c.Unary) and e.op == "!")


def _atoms(e: c.CExpr) -> Iterator[c.CExpr]:
    if isinstance(e, c.Binary) and e.op in LOGIC:
        yield from _atoms(e.left)
        yield from _atoms(e.right)
    elif isinstance(e, c.Unary) and e.op == "!":
        yield from _atoms(e.operand)
    else:
        yield e


class _Counting:
    """Rewrites the body of a function so that each decision and condition is counted."""

    def __init__(self, function: str, made: list[Decision]) -> None:
        self.function, self.made, self.first = function, made, len(made)

    def body(self, f: c.FunctionDef) -> c.FunctionDef:
        """The function with its counters, which are its own: it may run in several threads."""
        body = self.rewritten(f.body)
        numbers = range(self.first, len(self.made))
        counters = tuple(c.Declare("uint64_t", _seen(k), c.Number("0U")) for k in numbers)
        return replace(f, body=(*counters, *body))

    def rewritten(self, node: Any) -> Any:  # noqa: ANN401 - any piece of C
        """The same with counters."""
        if isinstance(node, tuple):
            return tuple(map(self.rewritten, node))
        if isinstance(node, c.IfStmt):
            asked = self.decision(node.condition)
            return c.IfStmt(asked, self.rewritten(node.then), self.rewritten(node.otherwise))
        if isinstance(node, c.Ternary):
            asked = self.decision(node.condition)
            return c.Ternary(asked, self.rewritten(node.then), self.rewritten(node.otherwise))
        if _is_logic(node) or (isinstance(node, c.Binary) and node.op in COMPARISONS):
            return self.decision(node)
        if isinstance(node, (c.CExpr, c.CStmt)) and not isinstance(node, c.Name):
            return type(node)(*map(self.rewritten, parts(node)))
        return node

    def decision(self, e: c.CExpr) -> c.CExpr:
        """A decision that is counted."""
        number = len(self.made)
        self.made.append((self.function, e))
        atoms = list(_atoms(e))
        if len(atoms) > CONDITIONS_MAX:
            return e
        seen, at = c.Unary("&", c.Name(_seen(number))), iter(range(len(atoms)))

        def counted(x: c.CExpr) -> c.CExpr:
            if isinstance(x, c.Binary) and x.op in LOGIC:
                return c.Binary(x.op, counted(x.left), counted(x.right))
            if isinstance(x, c.Unary) and x.op == "!":
                return c.Unary("!", counted(x.operand))
            number_of_condition = c.Number(f"{next(at)}U")
            return c.CallExpr("soter_condition", (seen, number_of_condition, self._inside(x)))

        return c.CallExpr("soter_outcome", (seen, c.Number(f"{number}U"), counted(e)))

    def _inside(self, x: c.CExpr) -> c.CExpr:
        """A condition in which decisions of its own may stand, as in an argument."""
        if isinstance(x, c.Binary):
            return c.Binary(x.op, self.rewritten(x.left), self.rewritten(x.right))
        made: c.CExpr = self.rewritten(x)
        return made


def _seen(number: int) -> str:
    return f"soter_seen_{number}"


# ---------------------------------------------------------------- while programs run


@contextmanager
def watched() -> Iterator[Callable[[], dict[tuple[str, str], set[Vector]]]]:
    """What is generated inside is counted; the function tells what its runs showed until then."""
    libraries: list[tuple[tuple[Decision, ...], Path]] = []
    token = _WATCHED.set(libraries)
    try:
        yield lambda: _shown(libraries)
    finally:
        _WATCHED.reset(token)


def printed(file: c.CFile, include: str) -> tuple[str, tuple[Decision, ...]]:
    """The text, with counters behind the line `include` where somebody watches; what is counted."""
    if _WATCHED.get() is None:
        return print_file(file), ()
    made: list[Decision] = []
    items = tuple(
        _Counting(x.name, made).body(x) if isinstance(x, c.FunctionDef) and x.body else x
        for x in file.items
    )
    text = COUNTERS.format(n=max(len(made), 1), most=VECTORS_MAX)
    return print_file(c.CFile(items)).replace(include, include + text, 1), tuple(made)


def note_library(decisions: tuple[Decision, ...], path: Path) -> None:
    """Says where the library is in which these are counted; what others showed of it is forgotten.

    A process that loads a library twice has one copy of its counters.
    """
    libraries = _WATCHED.get()
    if libraries is None or not decisions or any(path == known for _, known in libraries):
        return
    ctypes.memset(_vectors(decisions, path), 0, ctypes.sizeof(_Vectors) * len(decisions))
    libraries.append((decisions, path))


def _vectors(decisions: tuple[Decision, ...], path: Path) -> ctypes.Array[Any]:
    """The counters of a library, a row a decision."""
    return (_Vectors * len(decisions)).in_dll(ctypes.CDLL(str(path)), "traced_vectors")


def _shown(
    libraries: Sequence[tuple[tuple[Decision, ...], Path]],
) -> dict[tuple[str, str], set[Vector]]:
    """Function and numbered text of a decision -> its evaluations, of all these libraries."""
    found: dict[tuple[str, str], set[Vector]] = {}
    for decisions, path in libraries:
        rows = _vectors(decisions, path)
        counts: dict[tuple[str, str], int] = {}
        for (function, decision), row in zip(decisions, rows, strict=True):
            text = expr(decision)
            number = counts[function, text] = counts.get((function, text), -1) + 1
            low = (1 << CONDITIONS_MAX) - 1
            vectors = {(v & low, v >> 31 & low, bool(v >> 62 & 1)) for v in row if v}
            found.setdefault((function, f"{number} {text}"), set()).update(vectors)
    return found


def lacking(vectors: set[Vector], condition: int) -> str:
    """What is not shown of a condition of a decision; "": that it decides by itself (MC/DC)."""
    bit = 1 << condition
    values = {bool(true & bit) for seen, true, _ in vectors if seen & bit}
    if len(values) < 2:
        return f"never {'false' if True in values else 'true'}" if values else "never evaluated"
    for (seen, true, outcome), (others, also, other) in combinations(vectors, 2):
        if outcome != other and (true ^ also) & seen & others == bit:
            return ""
    return "true and false, but it never decided alone"
