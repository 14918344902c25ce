"""Functions of generated Soter source: expressions printed as such, checked, and called here.

Purpose: `function`: a function over forms that encloses some expressions; `certain`: one that says
whether a condition holds of everything that forms stand for. `functions_of` checks a text like any
program; `Caller` evaluates its functions as the interpreter does.
Non-goals: the arithmetic (`forms.soter`), how a tube is made of it (`tube.soter`), what stands in a
whole text (`tube_check.py`).
"""

from __future__ import annotations

from collections import Counter
from math import isinf
from typing import TYPE_CHECKING, Any

from soter.language.evaluate.arithmetic import StepFault
from soter.language.evaluate.environment import Environment
from soter.language.evaluate.statements import Evaluator
from soter.language.front_end import check_file
from soter.language.model.tree_walk import cost_of
from soter.verify.tubes.expressions import CONDITIONS, Node, in_order

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from typing import TypeAlias

    from soter.language.model.typed import FunSymbol

    Inputs: TypeAlias = Mapping[tuple[str, int], str]


NAME = "tubes.soter"


class TooLongError(Exception):
    """The loops of a text may take more operations than a step may."""


def functions_of(text: str) -> Mapping[str, FunSymbol]:
    """By name. The text is our own: any other error than `TooLongError` is a defect here."""
    checked = check_file(NAME, f"soter 1;\n{text}")
    if any(d.code == "T007" for d in checked.diagnostics.items):
        raise TooLongError
    assert checked.program is not None, checked.diagnostics
    assert not checked.diagnostics.has_errors, [str(d) for d in checked.diagnostics.items]
    return checked.program.funs


class Caller:
    """Calls functions without parameters of a system."""

    def __init__(self, text: str) -> None:
        self._functions = functions_of(text)
        self._evaluator = Evaluator({})

    def operations(self, name: str) -> int:
        """Of one call of a function of this name, at worst."""
        return cost_of(self._functions[name]).operations

    def holds(self, name: str, *arguments: Any) -> bool:  # noqa: ANN401 - values of the program
        """Whether a function of this name says so; one that faults does not."""
        return bool(self.value(name, *arguments))

    def value(self, name: str, *arguments: Any) -> Any:  # noqa: ANN401 - values of the program
        """What a function of this name gives; None where it faults."""
        try:
            return self._evaluator.function(self._functions[name])(Environment(), arguments)
        except StepFault:
            return None


FORMS, RANGES = "f", "i"
"""What operations of each begin with."""
WITH_NUMBER = ("add", "sub", "mul", "over", "friction")
"""What takes a number as it is, where its second operand is one."""
MAP = "map"
"""What the numbers of maps are called: no form knows more of them than that they are doubles."""


def function(
    name: str, parameters: str, roots: Sequence[Node], inputs: Inputs, result: str, of: str = FORMS
) -> str:
    """The text of `fun name(parameters): result`, an array of one form for each root, or range.

    `inputs`: kind and number of an input -> what stands for it.
    """
    body, names = _body(roots, inputs, of)
    given = ", ".join(names[x] for x in roots)
    return f"fun {name}({parameters}): {result} {{\n{body}  return [{given}];\n}}\n"


def certain(
    name: str,
    parameters: str,
    condition: Node,
    inputs: Inputs,
    *,
    truth: bool = True,
    first: str = "",
) -> str:
    """The text of `fun name(parameters): bool`: whether a condition certainly has a truth.

    `first`: what it begins with.
    """
    body, names = _body([condition], inputs, FORMS)
    said = _condition if truth else _refuted
    for c, name_of in _met_again(condition).items():
        body += f"  let {name_of} = {said(c, names)};\n"
        names[c] = name_of
    every = [said(c, names) for c in _parts(condition, "and" if truth else "or", names)]
    lines = "".join(f"  if !({c}) {{ return false; }}\n" for c in every)
    return f"fun {name}({parameters}): bool {{\n{first}{body}{lines}  return true;\n}}\n"


def _met_again(condition: Node) -> dict[Node, str]:
    """Names of conditions that several others are made of: written out at each, a text doubles."""
    order = [c for c in in_order([condition]) if c.op in ("and", "or")]
    uses = Counter(x for c in order for x in c.of)
    return {c: f"c{k}" for k, c in enumerate(order) if uses[c] > 1}


def _parts(condition: Node, op: str, named: Mapping[Node, str]) -> list[Node]:
    """What is joined by `op`, in one chain or in several; what has a name is one part."""
    found, todo = [], [condition]
    while todo:
        c = todo.pop()
        if c.op == op and c not in named:
            todo += reversed(c.of)
        else:
            found.append(c)
    return found


def _body(roots: Sequence[Node], inputs: Inputs, of: str) -> tuple[str, dict[Node, str]]:
    """Statements for all nodes but conditions, and what each node is called."""
    names: dict[Node, str] = {}
    order = in_order(roots)
    used = {*roots, *(x for e in order for x in _operands(e))}
    lines: list[str] = []
    for e in order:
        if e.op in CONDITIONS or e not in used:
            continue
        if e.op == "input" and e.of[0] != "m":
            names[e] = inputs[e.of]
            continue
        names[e] = f"t{len(lines)}"
        lines.append(f"  let {names[e]} = {_operation(e, names, of)};\n")
    return "".join(lines), names


def _operands(e: Node) -> list[Node]:
    """The nodes that an operation names: of a clamp not its ends, of a sum not a number."""
    if e.op == "min" and e.of[1].op == "number" and _is_floor(e.of[0]):
        return [e.of[0].of[0]]
    if e.op in WITH_NUMBER and _exact(e.of[-1]):
        return [e.of[0]]
    return [x for x in e.of if isinstance(x, Node)]


def _operation(e: Node, names: Mapping[Node, str], of: str) -> str:
    if value := _exact(e):
        return f"{of}_number({value})"
    if e.op in ("over", "friction"):
        return f"{of}_{e.op}({names[e.of[0]]}, {number(e.of[1].of[0])})"
    last = e.of[-1]
    if e.op in ("add", "sub", "mul") and (value := _exact(last)):
        if e.op == "sub":
            value = number(-last.of[0]) if last.op == "number" else f"-{value}"
        return f"{of}_{'times' if e.op == 'mul' else 'plus'}({names[e.of[0]]}, {value})"
    if e.op == "min" and last.op == "number" and _is_floor(e.of[0]):
        inner = e.of[0]
        ends = number(inner.of[1].of[0]), number(last.of[0])
        return f"{of}_clamp({names[inner.of[0]]}, {', '.join(ends)})"
    if e.op == "select":
        yes, no = _condition(e.of[0], names), _refuted(e.of[0], names)
        return f"{of}_select({yes}, {no}, {names[e.of[1]]}, {names[e.of[2]]})"
    arguments = ", ".join(names[x] for x in e.of)
    return f"{of}_{e.op}({arguments})"


def _exact(e: object) -> str:
    """What stands for a double: a constant, a number of a map; "" for anything else."""
    if not isinstance(e, Node):
        return ""
    if e.op == "number":
        return number(e.of[0])
    return f"{MAP}[{e.of[1]}]" if e.op == "input" and e.of[0] == "m" else ""


def _is_floor(e: Node) -> bool:
    return e.op == "max" and bool(e.of[1].op == "number")


def _condition(c: Node, names: Mapping[Node, str]) -> str:
    """That it certainly holds."""
    if c in names:
        return names[c]
    if c.op == "known":
        return "true" if c.of[0] else "false"
    if c.op in ("and", "or"):
        a, b = (_condition(x, names) for x in c.of)
        return f"({a} {'&&' if c.op == 'and' else '||'} {b})"
    if c.op == "inside":
        a, low, high = names[c.of[0]], number(c.of[1]), number(c.of[2])
        return f"({a}.lo >= {low} && {a}.hi <= {high})"
    return f"{names[c.of[0]]}.lo {'>' if c.op == 'positive' else '>='} 0.0"


def _refuted(c: Node, names: Mapping[Node, str]) -> str:
    """That it certainly does not."""
    if c in names:
        return names[c]
    if c.op == "known":
        return "false" if c.of[0] else "true"
    if c.op in ("and", "or"):
        a, b = (_refuted(x, names) for x in c.of)
        return f"({a} {'||' if c.op == 'and' else '&&'} {b})"
    if c.op == "inside":
        a, low, high = names[c.of[0]], number(c.of[1]), number(c.of[2])
        return f"({a}.hi < {low} || {a}.lo > {high})"
    return f"{names[c.of[0]]}.hi {'<=' if c.op == 'positive' else '<'} 0.0"


def number(x: float) -> str:
    """What is read as this double."""
    if isinf(x):
        return "ENDLESS" if x > 0 else "-ENDLESS"
    text = repr(x)
    return text if any(c in text for c in ".en") else text + ".0"
