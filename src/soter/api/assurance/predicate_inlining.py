"""Expands `safe`, `ttf` and `safer` of a module: their functions are inlined.

Purpose: `expanded_predicates` gives arithmetic over topics and named constants to a reader who
judges the predicate and does not read the program. Its text is an expression of Soter with the same
value; a function that is no expression (a loop, an assignment, an extern) stays a call, with its
text.
Non-goals: where it faults: a part that has a name stands outside the condition that it is under.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from soter.language.model import typed
from soter.language.model.tree_walk import nodes
from soter.language.model.types import (
    DurationType,
    EnumType,
    FloatType,
    IntType,
    RecordType,
    Type,
    Value,
    show_ns,
)
from soter.language.model.values import to_json
from soter.language.syntax.parsing.literals_and_operators import PRECEDENCE
from soter.report.safety_case import Definition, ExpandedPredicate

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from soter.language.model.system import Module, System


CONDITIONAL, UNARY, ATOM = 0, 6, 7
"""How tightly expressions without a binary operator bind, on the scale of `PRECEDENCE`."""
LONG, SHORT = 44, 16
"""From this length on a call's text gets a name, and so does an argument read several times."""
VALUE_MAX = 2000
"""Most characters of a constant's text; of a longer one, a table, only the beginning is shown."""
PLAIN = re.compile(r"-?[A-Za-z_0-9.\[\]]+")


@dataclass(frozen=True)
class _Text:
    """The text of an expression. `binds`: its precedence; `parts`: the texts of record fields."""

    text: str
    binds: int = ATOM
    parts: dict[str, _Text] = field(default_factory=dict)

    def bracketed(self, least: int) -> str:
        """The text, in parentheses if it binds less tightly than `least`."""
        return self.text if self.binds >= least else f"({self.text})"


def expanded_predicates(system: System, module: Module) -> Iterator[ExpandedPredicate]:
    """Yields `safe`, `ttf` and `safer` of a module, each expanded separately."""
    symbol = module.symbol
    for name, predicate in (("safe", symbol.safe), ("ttf", symbol.ttf), ("safer", symbol.safer)):
        if predicate is None:
            yield ExpandedPredicate(module.name, name, "")
            continue
        expansion = _Expansion(system, module)
        yield ExpandedPredicate(
            module.name,
            name,
            predicate.span.text_on_one_line,
            expansion.predicate_text(predicate),
            where=tuple(expansion.where),
            constants=tuple(expansion.constants.values()),
            read=tuple(expansion.read.values()),
            functions=tuple(expansion.functions.values()),
        )


@dataclass
class _Expansion:
    """Expands one predicate into text; a name stands for the same text everywhere in it."""

    system: System
    module: Module
    where: list[Definition] = field(default_factory=list)
    constants: dict[str, Definition] = field(default_factory=dict)
    """Name in the program -> constant or parameter."""
    read: dict[str, Definition] = field(default_factory=dict)
    """Name -> topic, or field of one, that the predicate reads."""
    functions: dict[str, Definition] = field(default_factory=dict)
    taken: set[str] = field(default_factory=set)

    def predicate_text(self, predicate: typed.TypedExpr) -> str:
        """The text of the predicate; the named texts that it does not use are dropped."""
        topics = {
            self.topic_name(n.topic): n.type
            for n in nodes([predicate])
            if isinstance(n, typed.TopicRead)
        }
        self.taken |= {name.partition(".")[0] for name in topics}
        text = self.expression_text(predicate, {}).text
        if self.where and self.where[-1].name == text:
            text = self.where.pop().text  # the predicate is nothing but a call
        used = text
        for known in reversed(self.where[:]):  # of a record perhaps only fields are used
            if re.search(rf"(?<![\w.]){known.name}(?!\w)", used):
                used = f"{known.text} ; {used}"
            else:
                self.where.remove(known)
        self.read = _definitions_in(used, topics)
        return text

    # ------------------------------------------------------------ names

    def named_text(self, base: str, value: _Text) -> _Text:
        """Names a text, or each long field of a record; equal texts share a name."""
        if value.parts:
            parts = {
                name: self.named_text(f"{base}_{name}", part) if _is_long(part) else part
                for name, part in value.parts.items()
            }
            return _record_text(parts)
        for known in self.where:
            if known.text == value.text:
                return _Text(known.name)
        name = self.free_name(base.rpartition(".")[2].lstrip("_") or "part")
        self.where.append(Definition(name, value.text))
        return _Text(name)

    def free_name(self, base: str) -> str:
        """The name `base`, with a number behind it if `base` is already taken."""
        name, number = base, 1
        while name in self.taken:
            number += 1
            name = f"{base}_{number}"
        self.taken.add(name)
        return name

    def noted_constant(self, name: str, t: Type, value: Value) -> _Text:
        """The name of a constant or parameter; notes the value for the reader."""
        known = self.constants.get(name)
        if known is None:
            text = _constant_text(t, value)
            if len(text) > VALUE_MAX:
                text = f"{text[:VALUE_MAX]}… ({len(text):,} letters: the program has all)"
            known = Definition(self.free_name(name.rpartition(".")[2]), text, _unit_of_type(t))
            self.constants[name] = known
        return _Text(known.name)

    def topic_name(self, symbol: typed.TopicSymbol) -> str:
        """The name of a topic in the system."""
        index = self.module.scope.topics.get(symbol)
        return symbol.name if index is None else self.system.topics[index].name

    # ------------------------------------------------------------ expressions

    def expression_text(self, e: typed.TypedExpr, env: dict[typed.Variable, _Text]) -> _Text:
        """The text of an expression; `env` has the texts of parameters and lets in scope."""
        match e:
            case typed.Literal() if e.name is not None and not isinstance(e.type, EnumType):
                return self.noted_constant(e.name, e.type, e.value)
            case typed.Literal():
                text = _constant_text(e.type, e.value)
                return _Text(text, UNARY if text.startswith("-") else ATOM)
            case typed.ParamRead():
                params = {**self.module.around, **self.module.scope.params}
                return self.noted_constant(e.param.name, e.param.type, params[e.param])
            case typed.VarRead():
                return env[e.variable]
            case typed.TypedField():
                return self.field_text(e, env)
            case typed.TypedCall():
                return self.call_text(e, env)
            case typed.Narrow():
                return self.expression_text(e.operand, env)
            case typed.TypedUnary() | typed.TypedBinary() | typed.Vector() | typed.Conditional():
                return self.operation_text(e, env)
            case typed.Aggregate():
                return self.literal_text(e, env)
        return _Text(self.atom_text(e, env))

    def operation_text(self, e: typed.TypedExpr, env: dict[typed.Variable, _Text]) -> _Text:
        """The text of an operation, with parentheses where syntax or readability needs them."""
        if isinstance(e, typed.TypedUnary):
            operand = self.expression_text(e.operand, env)
            within = operand.bracketed(ATOM if operand.text.startswith(("-", "!")) else UNARY)
            return _Text(f"{e.op}{within}", UNARY)
        if isinstance(e, typed.Conditional):
            sides = (e.condition, e.then, e.otherwise)
            if_, then, otherwise = (self.expression_text(x, env).bracketed(1) for x in sides)
            return _Text(f"{if_} ? {then} : {otherwise}", CONDITIONAL)
        assert isinstance(e, (typed.TypedBinary, typed.Vector))
        binds = PRECEDENCE[e.op]
        least = {"||": PRECEDENCE["<"]}.get(e.op, binds)  # `a && b` in `a || …` has brackets
        least += e.op in ("<", "<=", ">", ">=", "==", "!=")
        left, right = self.expression_text(e.left, env), self.expression_text(e.right, env)
        signed = right.text.startswith("-") and e.op in ("+", "-", "*", "/", "%")
        beside = ATOM if signed else max(least, binds + 1)
        same = isinstance(e.left, typed.TypedBinary) and e.left.op == e.op and binds == left.binds
        first = left.bracketed(binds if same else least)
        return _Text(f"{first} {e.op} {right.bracketed(beside)}", binds)

    def field_text(self, e: typed.TypedField, env: dict[typed.Variable, _Text]) -> _Text:
        """The text of a field; if the record is written out, only the text of that field."""
        target = self.expression_text(e.target, env)
        assert isinstance(e.target.type, RecordType)
        name = e.target.type.fields[e.index][0]
        return target.parts.get(name) or _Text(f"{target.bracketed(ATOM)}.{name}")

    def literal_text(self, e: typed.Aggregate, env: dict[typed.Variable, _Text]) -> _Text:
        """The text of a record, array or list literal."""
        values = [self.expression_text(x, env) for x in e.elements]
        fields = getattr(e.type, "fields", None)
        if fields is None:
            return _Text(f"[{', '.join(x.text for x in values)}]")
        by_field = dict(zip(e.order or range(len(values)), values, strict=True))
        return _record_text({name: by_field[i] for i, (name, _) in enumerate(fields)})

    def atom_text(self, e: typed.TypedExpr, env: dict[typed.Variable, _Text]) -> str:
        """The text of an expression that never needs parentheses around it."""
        match e:
            case typed.TopicRead():
                return self.topic_name(e.topic)
            case typed.AgeRead():
                return f"age({self.topic_name(e.topic)})"
            case typed.ModeRead() | typed.MarginRead():
                word = "mode" if isinstance(e, typed.ModeRead) else "margin"
                return f"{word}({e.module if isinstance(e.module, str) else e.module.name})"
            case typed.Builtin():
                return (
                    f"{e.name}({', '.join(self.expression_text(x, env).text for x in e.arguments)})"
                )
            case typed.Index():
                index = self.expression_text(e.index, env).text
                return f"{self.expression_text(e.target, env).bracketed(ATOM)}[{index}]"
            case typed.TypedLength():
                return f"{self.expression_text(e.target, env).bracketed(ATOM)}.len"
        return e.span.text_on_one_line  # `time`, `dt`: the same everywhere

    # ------------------------------------------------------------ functions

    def call_text(self, e: typed.TypedCall, env: dict[typed.Variable, _Text]) -> _Text:
        """The text of a function's result, or of the call if the body is no expression."""
        fun = e.fun
        texts = [self.expression_text(x, env) for x in e.arguments]
        short = fun.name.rpartition(".")[2]
        if fun.prelude or fun.body is None or not _is_expression(fun.body):
            return _Text(f"{self.kept_call_name(fun)}({', '.join(x.text for x in texts)})")
        inner = {}
        for variable, value in zip(fun.parameters, texts, strict=True):
            reads = [n for n in nodes(fun.body) if isinstance(n, typed.VarRead)]
            often = sum(n.variable is variable for n in reads) > 1
            inner[variable] = (
                self.named_text(variable.name, value) if often and _is_long(value) else value
            )
        result = self.body_text(fun.body, inner)
        if len(result.text) > LONG:
            return self.named_text(short, result)
        return result

    def kept_call_name(self, fun: typed.FunSymbol) -> str:
        """The name of a function that stays a call; notes its source and those it calls."""
        short = fun.name.rpartition(".")[2]
        if fun.prelude:
            return short
        if fun.name in self.functions:
            return self.functions[fun.name].name
        name = self.free_name(short)
        self.functions[fun.name] = Definition(name, "")
        called = {}
        for n in nodes(fun.body or ()):
            if isinstance(n, typed.TypedCall):
                called[n.span.text.partition("(")[0].strip()] = self.kept_call_name(n.fun)
            elif isinstance(n, typed.ParamRead) or (isinstance(n, typed.Literal) and n.name):
                called[n.span.text_on_one_line] = self.expression_text(n, {}).text
        notes = [f"{part} is {text}" for part, text in called.items() if part != text]
        text = name + _source_text(fun)[len(short) :] + f"  // {', '.join(notes)}" * bool(notes)
        self.functions[fun.name] = Definition(name, text)
        return name

    def body_text(self, body: Sequence[typed.TypedStmt], env: dict[typed.Variable, _Text]) -> _Text:
        """The text of the value that a body returns; `_is_expression` must hold for the body."""
        first, rest = body[0], body[1:]
        if isinstance(first, typed.TypedReturn):
            return self.expression_text(first.value, env)
        if isinstance(first, typed.TypedDeclare):
            value = self.expression_text(first.value, env)
            value = value if _is_plain(value) else self.named_text(first.variable.name, value)
            return self.body_text(rest, {**env, first.variable: value})
        assert isinstance(first, typed.TypedIf)
        conditions = [self.expression_text(condition, env) for condition, _ in first.arms]
        results = [self.body_text(arm, env) for _, arm in first.arms]
        text = self.body_text((*first.otherwise, *rest), env)
        for condition, result in reversed(list(zip(conditions, results, strict=True))):
            shown = f"{condition.bracketed(1)} ? {result.bracketed(1)} : {text.bracketed(1)}"
            text = _Text(shown, CONDITIONAL)
        return text


def _is_expression(body: Sequence[typed.TypedStmt]) -> bool:
    """Whether a body consists of `let`s, `if`s whose arms return, and a `return`."""
    for i, s in enumerate(body):
        if isinstance(s, typed.TypedReturn):
            return True
        if isinstance(s, typed.TypedDeclare) and s.variable.kind == "let":
            continue
        if not isinstance(s, typed.TypedIf) or not all(_is_expression(arm) for _, arm in s.arms):
            return False
        return _is_expression((*s.otherwise, *body[i + 1 :]))
    return False


def _is_plain(value: _Text) -> bool:
    return PLAIN.fullmatch(value.text) is not None


def _is_long(value: _Text) -> bool:
    return not _is_plain(value) and len(value.text) > SHORT


def _record_text(parts: dict[str, _Text]) -> _Text:
    shown = (f"{name}: {x.text}" for name, x in parts.items())
    return _Text(f"{{ {', '.join(shown)} }}", parts=parts)


def _definitions_in(text: str, topics: dict[str, Type]) -> dict[str, Definition]:
    """Maps each topic and topic field that a text mentions to its type and unit."""
    read = {}
    for name, t in topics.items():
        for path in re.findall(rf"(?<![\w.]){re.escape(name)}((?:\.\w+)*)(?![\w:])", text):
            leaf = t
            for part in path.split(".")[1:]:
                leaf = dict(getattr(leaf, "fields", ())).get(part, leaf)
            read[name + path] = Definition(name + path, str(leaf), _unit_of_type(leaf))
    return dict(sorted(read.items()))


def _unit_of_type(t: Type) -> str:
    return t.unit if isinstance(t, (FloatType, IntType)) else ""


def _constant_text(t: Type, value: Value) -> str:
    """A constant as Soter source if it is a scalar, else as JSON."""
    if isinstance(t, EnumType):
        return f"{t.name.rpartition('.')[2]}.{t.members[value]}"
    if isinstance(t, DurationType):
        return show_ns(value)
    if isinstance(value, (bool, int)):
        return str(value).lower()
    return repr(value) if isinstance(value, float) else json.dumps(to_json(t, value), default=str)


def _source_text(fun: typed.FunSymbol) -> str:
    """The source of a function from its name on; only the first line if it is an extern."""
    text = fun.span.source.text[fun.span.start :]
    end = text.find(";") if fun.body is None else _closing_brace(text)
    return text[: end + 1]


def _closing_brace(text: str) -> int:
    """The index of the brace that closes the first `{`; comments and strings do not count."""
    depth = 0
    for token in re.finditer(r'//[^\n]*|/\*.*?\*/|"(?:\\.|[^"\\])*"|[{}]', text, re.DOTALL):
        depth += {"{": 1, "}": -1}.get(token[0], 0)
        if depth == 0 and token[0] == "}":
            return token.start()
    return len(text) - 1
