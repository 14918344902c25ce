"""Writes functions of Soter source that enclose expressions, and calls them.

Purpose: `fun_text` writes a function over forms (or ranges) that encloses some expressions;
`sure_text` one that is true only where a condition holds for all values that the forms enclose.
`checked_text` checks such a text like any program. `Caller` evaluates its functions as the
interpreter does.
Non-goals: the arithmetic (`forms.soter`), how a tube is made of it (`tube.soter`), what a whole
text holds (`tube_check.py`).
"""

from __future__ import annotations

from collections import Counter
from importlib.resources import files
from math import isinf
from typing import TYPE_CHECKING, Any

from soter.language.evaluate.arithmetic import StepFault
from soter.language.evaluate.environment import Environment
from soter.language.evaluate.statements import Evaluator
from soter.language.front_end import check_file
from soter.language.model.tree_walk import cost_of
from soter.verify.tubes.expression_graph import CONDITIONS, Node, in_order

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from typing import TypeAlias

    from soter.language.front_end import CheckResult
    from soter.language.model.typed import FunSymbol

    Inputs: TypeAlias = Mapping[tuple[str, int], str]


NAME = "tubes.soter"


class TooLongError(Exception):
    """Raised if a text may need more operations than a program's step may take (T007)."""


def functions_of(text: str) -> Mapping[str, FunSymbol]:
    """The functions of a text, by name; raises `TooLongError`."""
    program = checked_text(text).program
    assert program is not None
    return program.funs


def checked_text(text: str) -> CheckResult:
    """The text, checked like any program; `TooLongError`. Other errors are defects of Soter."""
    checked = check_file(NAME, f"soter 1;\n{text}")
    if any(d.code == "T007" for d in checked.diagnostics.items):
        raise TooLongError
    assert not checked.diagnostics.has_errors, [str(d) for d in checked.diagnostics.items]
    assert checked.program is not None, checked.diagnostics
    return checked


class Caller:
    """Calls the functions of one text in the interpreter."""

    affordable = 10**10
    """The most operations for all parts of a rest that are tried: they take some minutes."""

    def __init__(self, text: str) -> None:
        self.checked = checked_text(text)
        assert self.checked.program is not None
        self._functions = self.checked.program.funs
        self._evaluator = Evaluator({})
        self.fault = ""
        """The message of the fault in the last call; "" where that call did not fault."""

    def operations(self, name: str) -> int:
        """The largest number of operations that one call of function `name` takes."""
        return cost_of(self._functions[name]).operations

    def returns_true(self, name: str, *arguments: Any) -> bool:  # noqa: ANN401 - values of the program
        """Whether function `name` returns true; False if it returns false or faults."""
        return bool(self.result(name, *arguments))

    def result(self, name: str, *arguments: Any) -> Any:  # noqa: ANN401 - values of the program
        """The value that function `name` returns; None if it faults."""
        self.fault = ""
        try:
            return self._evaluator.closure_of(self._functions[name])(Environment(), arguments)
        except StepFault as fault:
            self.fault = fault.detail
            return None


FORMS, RANGES = "f", "i"
"""The first letter of operations on forms (`f_add`), and of those on ranges (`i_add`)."""
WITH_NUMBER = ("add", "sub", "mul", "over", "friction")
"""The operations that have a variant whose second operand is a number instead of a form."""
MAP = "map"
"""The parameter that holds the numbers of maps: each is a double, without an error of its own."""


def fun_text(
    name: str, parameters: str, roots: Sequence[Node], inputs: Inputs, result: str, of: str = FORMS
) -> str:
    """The text of `fun name(parameters): result`, which returns a form or range for each root.

    `inputs` has the text of each input by kind and number; `of` is `FORMS` or `RANGES`.
    """
    body, names = _statements_for_nodes(roots, inputs, of)
    results = ", ".join(names[x] for x in roots)
    return f"fun {name}({parameters}): {result} {{\n{body}  return [{results}];\n}}\n"


def sure_text(
    name: str,
    parameters: str,
    condition: Node,
    inputs: Inputs,
    *,
    truth: bool = True,
    first: str = "",
) -> str:
    """The text of `fun name(parameters): bool`, true only if the condition surely equals `truth`.

    `first` has the statements with which the function begins.
    """
    body, names = _statements_for_nodes([condition], inputs, FORMS)
    text_of = _surely_true_text if truth else _surely_false_text
    for c, name_of in _shared_conditions(condition).items():
        body += f"  let {name_of} = {text_of(c, names)};\n"
        names[c] = name_of
    every = [text_of(c, names) for c in _joined_parts(condition, "and" if truth else "or", names)]
    lines = "".join(f"  if !({c}) {{ return false; }}\n" for c in every)
    return f"fun {name}({parameters}): bool {{\n{first}{body}{lines}  return true;\n}}\n"


def decided_text(name: str, parameters: str, conditions: Sequence[Node], inputs: Inputs) -> str:
    """The text of a function of ranges that returns, per condition, surely true, surely false."""
    body, names = _statements_for_nodes(conditions, inputs, RANGES)
    bits = [of(c, names) for c in conditions for of in (_surely_true_text, _surely_false_text)]
    return (
        f"fun {name}({parameters}): bool[{len(bits)}] {{\n{body}  return {array_text(bits)};\n}}\n"
    )


def _shared_conditions(condition: Node) -> dict[Node, str]:
    """A name for each condition that is used more than once, to write it only once."""
    order = [c for c in in_order([condition]) if c.op in ("and", "or")]
    uses = Counter(x for c in order for x in c.of)
    return {c: f"c{k}" for k, c in enumerate(order) if uses[c] > 1}


def _joined_parts(condition: Node, op: str, named: Mapping[Node, str]) -> list[Node]:
    """The conditions that `op` joins, also in nested joins; conditions in `named` are not split."""
    found, todo = [], [condition]
    while todo:
        c = todo.pop()
        if c.op == op and c not in named:
            todo += reversed(c.of)
        else:
            found.append(c)
    return found


def _statements_for_nodes(
    roots: Sequence[Node], inputs: Inputs, of: str
) -> tuple[str, dict[Node, str]]:
    """The `let` statements for all nodes but conditions, and the name of each node."""
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
        lines.append(f"  let {names[e]} = {_operation_text(e, names, of)};\n")
    return "".join(lines), names


def _operands(e: Node) -> list[Node]:
    """The nodes that the text of an operation names: neither ends of clamps nor numbers."""
    if e.op == "min" and e.of[1].op == "number" and _is_lower_limit(e.of[0]):
        return [e.of[0].of[0]]
    if e.op in WITH_NUMBER and _exact_text(e.of[-1]):
        return [e.of[0]]
    return [x for x in e.of if isinstance(x, Node)]


def _operation_text(e: Node, names: Mapping[Node, str], of: str) -> str:
    if value := _exact_text(e):
        return f"{of}_number({value})"
    if e.op in ("over", "friction"):
        return f"{of}_{e.op}({names[e.of[0]]}, {number_text(e.of[1].of[0])})"
    last = e.of[-1]
    if e.op in ("add", "sub", "mul") and (value := _exact_text(last)):
        if e.op == "sub":
            value = number_text(-last.of[0]) if last.op == "number" else f"-{value}"
        return f"{of}_{'times' if e.op == 'mul' else 'plus'}({names[e.of[0]]}, {value})"
    if e.op == "min" and last.op == "number" and _is_lower_limit(e.of[0]):
        inner = e.of[0]
        ends = number_text(inner.of[1].of[0]), number_text(last.of[0])
        return f"{of}_clamp({names[inner.of[0]]}, {', '.join(ends)})"
    if e.op == "select":
        yes, no = _surely_true_text(e.of[0], names), _surely_false_text(e.of[0], names)
        return f"{of}_select({yes}, {no}, {names[e.of[1]]}, {names[e.of[2]]})"
    arguments = ", ".join(names[x] for x in e.of)
    return f"{of}_{e.op}({arguments})"


def _exact_text(e: object) -> str:
    """The text of an exact double, if `e` is a constant or a number of a map; "" otherwise."""
    if not isinstance(e, Node):
        return ""
    if e.op == "number":
        return number_text(e.of[0])
    return f"{MAP}[{e.of[1]}]" if e.op == "input" and e.of[0] == "m" else ""


def _is_lower_limit(e: Node) -> bool:
    return e.op == "max" and bool(e.of[1].op == "number")


def _surely_true_text(c: Node, names: Mapping[Node, str]) -> str:
    """The text of a boolean expression that is true only if the condition certainly holds."""
    if c in names:
        return names[c]
    if c.op == "known":
        return "true" if c.of[0] else "false"
    if c.op in ("and", "or"):
        a, b = (_surely_true_text(x, names) for x in c.of)
        return f"({a} {'&&' if c.op == 'and' else '||'} {b})"
    if c.op == "inside":
        a, low, high = names[c.of[0]], number_text(c.of[1]), number_text(c.of[2])
        return f"({a}.lo >= {low} && {a}.hi <= {high})"
    if c.op == "branch":
        return f"on[{2 * c.of[0]}]"
    return f"{names[c.of[0]]}.lo {'>=' if c.op == 'not negative' else '>'} 0.0"


def _surely_false_text(c: Node, names: Mapping[Node, str]) -> str:
    """The text of a boolean expression that is true only if the condition certainly fails."""
    if c in names:
        return names[c]
    if c.op == "known":
        return "false" if c.of[0] else "true"
    if c.op in ("and", "or"):
        a, b = (_surely_false_text(x, names) for x in c.of)
        return f"({a} {'||' if c.op == 'and' else '&&'} {b})"
    if c.op == "inside":
        a, low, high = names[c.of[0]], number_text(c.of[1]), number_text(c.of[2])
        return f"({a}.hi < {low} || {a}.lo > {high})"
    if c.op == "branch":
        return f"on[{2 * c.of[0] + 1}]"
    return f"{names[c.of[0]]}.hi {'<=' if c.op == 'positive' else '<'} 0.0"


def number_text(x: float) -> str:
    """The text of a literal or constant of the language with exactly this double as value."""
    if isinf(x):
        return "ENDLESS" if x > 0 else "-ENDLESS"
    text = repr(x)
    return text if any(c in text for c in ".en") else text + ".0"


def exact_form_text(value: float) -> str:
    """The text of a form that encloses only this number."""
    return form_text(value, 0.0, value, value)


def form_text(c: float, r: float, low: float, high: float) -> str:
    """The text of a form without symbols, from centre, remainder and ends."""
    ends = f"lo: {number_text(low)}, hi: {number_text(high)}"
    return f"{{ c: {number_text(c)}, r: {number_text(r)}, {ends}, g: NONE }}"


def numbers_text(values: Iterable[float]) -> str:
    """The text of an array of these numbers."""
    return array_text([number_text(float(v)) for v in values])


def array_text(items: Sequence[str]) -> str:
    """The text of an array of these items."""
    return f"[{', '.join(items)}]"


def text_of_package_file(name: str) -> str:
    """The text of the file `name` of this package, which is the same for all modules."""
    return (files(__package__) / name).read_text(encoding="utf-8")
