"""Makes the text that an editor shows for a declaration whose name is under the mouse.

Purpose: `hover_text` shows a declaration at a glance: its head as it is written, the comment above
it, its type, set, age and period, and the numbers that the last good check computed.
Non-goals: where the mouse is (`requests.py`); words of the language (`language_words.py`).
"""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostics
from soter.editor.protocol_conversions import path_of_span
from soter.language.check.constants_and_types import Calculator
from soter.language.load.loader import LoadedFile
from soter.language.model.types import DurationType, Type, Value, write_ns
from soter.language.model.values import Table, to_json
from soter.language.syntax import tree

if TYPE_CHECKING:
    from collections.abc import Iterable

    from soter.editor.name_definitions import Definition
    from soter.language.front_end import CheckResult
    from soter.language.model.typed import TopicSymbol, TypedExpr, TypedProgram


LINES_MAX = 12
"""How many lines of a declaration are shown."""
VALUE_MAX = 200
PREFIX = re.compile(r"(?:[A-Za-z_]\w*\.)+(?=[A-Za-z_])")
"""What stands before the names of imported types."""
BUDGETS = (20_000, 200_000)
"""Most operations for one number, and for all numbers, as a person waits for them."""


def hover_text(d: Definition, checked: CheckResult | None) -> str:
    """Markdown about a definition; `checked`: the program's last check without errors."""
    parts = [f"```soter\n{declaration_head(d)}\n```"]
    parts += fact_lines(d, checked)
    if comment := comment_above(d):
        parts.append(comment)
    return "\n\n".join(parts)


def declaration_head(d: Definition) -> str:
    """The declaration as written, without its body."""
    node = d.node
    if isinstance(node, (tree.NodeDecl, tree.PlantDecl, tree.RtaDecl)):
        return _shown_lines(node.span.text, _shown_words(node))
    if isinstance(node, (tree.SystemDecl, tree.TestDecl)):
        return _text_before(node.span.text, "{").rstrip() + " { ... }"
    if isinstance(node, tree.FunDecl) and d.kind == "function":
        return " ".join(_text_before(node.span.text, "{").split()).rstrip(";")
    if d.kind in {"field", "argument"}:
        return f"({d.kind}) {d.name}: {type_text(d)}"
    if d.kind == "member":
        assert isinstance(node, tree.TypeDecl)
        return f"(member) {node.name.text}.{d.name}"
    if d.kind in {"let", "loop variable"} and getattr(node, "type", None) is None:
        return f"({d.kind}) {d.name}: {type_text(d)}"
    text = getattr(node, "span", d.span).text
    if d.kind == "instance":
        text = _text_before(text, "{").rstrip()
    lines = text.splitlines()
    if len(lines) > LINES_MAX:
        lines = [*lines[:LINES_MAX], "  ..."]
    return "\n".join(lines) if d.kind in DECLARED else f"({d.kind}) " + "\n".join(lines)


DECLARED = {"type", "constant", "parameter", "topic", "import"}


def _shown_words(node: tree.NodeDecl | tree.PlantDecl | tree.RtaDecl) -> tuple[str, ...]:
    """The words that begin a shown line of this body."""
    if isinstance(node, tree.NodeDecl):
        return ("subscribes", "publishes", "takes", "wcet")
    if isinstance(node, tree.PlantDecl):
        return ("reads", "state", "disturbance", "measured")
    return ("ac", "sc", "period", "safe", "safer", "ttf", "rest")


def _shown_lines(text: str, words: tuple[str, ...]) -> str:
    """The head of a body, and the lines in the body that begin with one of the words."""
    lines = [line.rstrip() for line in text.splitlines()]
    kept = [line for line in lines[1:] if line.split(" ", 1)[0:1] and _first_word(line) in words]
    shown = [f"  {line.strip()}" for line in kept[: LINES_MAX - 2]]
    return "\n".join([lines[0], *shown, "}" if len(lines) > 1 else ""]).rstrip()


def _first_word(line: str) -> str:
    parts = line.split()
    return parts[0] if parts else ""


def _text_before(text: str, sign: str) -> str:
    return text.split(sign, 1)[0]


def comment_above(d: Definition) -> str:
    """The comment lines right above a declaration, and the comment that follows its end."""
    node = d.node
    if not isinstance(node, tree.Decl) or d.kind in {"member", "instance"}:
        return ""
    source = node.span.source
    number = node.span.line - 1
    lines: list[str] = []
    while number >= 1 and source.line(number).lstrip().startswith("//"):
        lines.append(source.line(number).strip().lstrip("/").strip())
        number -= 1
    lines.reverse()
    last = source.line(source.line_of(node.span.end))
    behind = last[source.column_of(node.span.end) - 1 :].strip()
    if behind.startswith("//"):
        lines.append(behind.lstrip("/").strip())
    return " ".join(line for line in lines if line.strip("-= "))


def fact_lines(d: Definition, checked: CheckResult | None) -> list[str]:
    """Lines with computed facts: values, periods, sets; [] without a check."""
    program = None if checked is None else checked.program
    if program is None or checked is None or checked.loaded is None:
        return []
    prefix = next((f.prefix for f in checked.loaded.files if f.path == path_of_span(d.span)), None)
    return [] if prefix is None else list(_facts_of_name(d.kind, prefix + d.name, program))


def _facts_of_name(kind: str, name: str, program: TypedProgram) -> Iterable[str]:
    number = _Numbers(program)
    if kind == "constant" and name in program.consts:
        const = program.consts[name]
        yield f"value: `{value_text(const.type, const.value)}`"
    elif kind == "parameter" and name in program.params:
        yield f"default: `{number(program.params[name].default)}`"
    elif kind == "topic" and name in program.topics:
        topic = program.topics[name]
        for path, bounds in topic.values.items():
            path_text = ".".join((name, *path))
            yield f"`{path_text}` in [{number(bounds.low)}, {number(bounds.high)}]"
        if topic.max_age is not None:
            yield f"fresh for {number(topic.max_age)}"
        else:
            yield "never stale: no `max_age`"
        if topic.static:
            yield "static: what it says stays true"
        yield _topic_users_line(topic, program)
    elif kind in {"node", "plant", "module"}:
        symbol = program.nodes.get(name) or program.plants.get(name) or program.modules.get(name)
        if symbol is not None:
            yield f"period: {number(symbol.period)}"


def _topic_users_line(topic: TopicSymbol, program: TypedProgram) -> str:
    """A line on the parts that publish a topic, and the parts that read it."""
    nodes, plants = program.nodes.values(), program.plants.values()
    writers = [n.name for n in nodes if topic in n.publishes]
    writers += [p.name for p in plants if topic in [t for t, _ in p.drives]]
    readers = [n.name for n in nodes if topic in [s.topic for s in n.subscribes]]
    readers += [p.name for p in plants if topic in p.reads]
    return f"published by {_name_list(writers)}; read by {_name_list(readers)}"


def _name_list(names: list[str]) -> str:
    return ", ".join(f"`{n}`" for n in names) if names else "nobody"


class _Numbers:
    """Evaluates expressions of a program with all parameters at their defaults."""

    def __init__(self, program: TypedProgram) -> None:
        constant = Calculator(Diagnostics(), None, BUDGETS)
        values = {p: constant.value(p.default, "") for p in program.params.values()}
        params = {p: value for p, value in values.items() if value is not None}
        self._calculator = Calculator(Diagnostics(), params, BUDGETS)

    def __call__(self, expr: TypedExpr) -> str:
        """The value as text; the source of the expression if its value cannot be computed."""
        value = self._calculator.value(expr, "")
        return " ".join(expr.span.text.split()) if value is None else value_text(expr.type, value)


def value_text(t: Type, value: Value) -> str:
    """A value as people write it, shortened if it is long."""
    if isinstance(t, DurationType):
        return write_ns(value)
    if isinstance(value, Table):
        return f"a table of {len(value)}"
    text = json.dumps(to_json(t, value), default=str)
    return text if len(text) <= VALUE_MAX else text[:VALUE_MAX] + "..."


def type_text(d: Definition) -> str:
    """The type of a definition as the source has it, or else the checker's name for it."""
    written = d.node[1] if isinstance(d.node, tuple) else getattr(d.node, "type", None)
    if isinstance(written, tree.TypeExpr):
        return " ".join(written.span.text.split())
    if isinstance(d.of, LoadedFile):
        return "import"
    return "?" if d.of is None else PREFIX.sub("", getattr(d.of, "name", None) or str(d.of))
