"""Declarations and whole files: tokens to tree.

Purpose: `parse(source, diagnostics)`: one tree and every syntax error of the file in one pass,
in the order of the text. A declaration with a mistake keeps what could be read of it; its name
goes into `File.broken`, so that later passes do not complain about what is missing.
Non-goals: anything that needs another declaration or file (`program/`).
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, TypeVar

from soter.diagnostics.diagnostic import Diagnostic, Label
from soter.diagnostics.span import Span
from soter.syntax import tree
from soter.syntax.cursor import ERRORS_MAX, STATEMENT_WORDS, Panic, TooManyErrorsError
from soter.syntax.statements import StatementParser
from soter.syntax.tokens import EOF, ERROR, INT, NAME, STRING, lex, string_value, visible

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from typing import Any

    from soter.diagnostics.diagnostic import Diagnostics
    from soter.diagnostics.source import Source

#: The language edition this compiler reads.
EDITION = 1

_FOREIGN_FUN = frozenset(["func", "def", "function", "fn", "fund", "proc", "procedure"])
_FOREIGN_DECLARATION = {
    "struct": "a record type is declared by `type Name = { x: float };`",
    "class": "a record type is declared by `type Name = { x: float };`",
    "record": "a record type is declared by `type Name = { x: float };`",
    "typedef": "a type is declared by `type Name = ...;`",
    "enum": "an enumeration is declared by `type Name = enum { A, B };`",
    "let": "a constant of the file is declared by `const NAME: float = ...;`",
    "var": "a variable belongs in a node; a constant is declared by `const NAME: float = ...;`",
    "module": "a module is declared by `rta Name { ... }`",
    "machine": "a node is declared by `node Name period 10ms { ... }`",
    "include": 'a file is imported by `import "file.soter" as name;`',
    "using": 'a file is imported by `import "file.soter" as name;`',
    "from": 'a file is imported by `import "file.soter" as name;`',
    "channel": "a topic is declared by `topic name: float in [-1.0, 1.0];`",
    "signal": "a topic is declared by `topic name: float in [-1.0, 1.0];`",
    "input": "an input is declared by `input topic name: float in [-1.0, 1.0];`",
}
_BODY_ITEM = frozenset(
    ["subscribes", "publishes", "step", "state", "der", "next", "period", "phase"]
)

_Parts = TypeVar("_Parts")


def parse(source: Source, diagnostics: Diagnostics) -> tree.File:
    """Read one file; errors go to `diagnostics`, and a tree always comes back."""
    return parse_tokens(source, diagnostics)[0]


def parse_tokens(source: Source, diagnostics: Diagnostics) -> tuple[tree.File, Parser]:
    """Read one file and keep the parser, whose tokens and marks the printer needs."""
    parser = Parser(lex(source))
    file = parser.file()
    problems = parser.tokens.problems + parser.problems
    problems.sort(key=lambda d: d.primary.span.start if d.primary else 0)
    for problem in problems[:ERRORS_MAX]:
        diagnostics.add(problem)
    if len(problems) >= ERRORS_MAX:
        diagnostics.add(_too_many(problems[ERRORS_MAX - 1]))
    return file, parser


def _too_many(last: Diagnostic) -> Diagnostic:
    primary = Label(last.primary.span, "the last error that is shown") if last.primary else None
    message = f"this file has {ERRORS_MAX} syntax errors or more"
    note = "the rest of the file was not read: is it a Soter file?"
    return Diagnostic("S021", message, primary, notes=(note,))


# ---------------------------------------------------------------- parts of a body


@dataclass(slots=True)
class _NodeParts:
    subscribes: list[tree.Subscription] = field(default_factory=list)
    publishes: list[tree.Ref] = field(default_factory=list)
    failsafe: list[tuple[tree.Ref, tree.Expr]] = field(default_factory=list)
    locals: list[tree.LocalVar] = field(default_factory=list)
    assumes: list[tree.Expr] = field(default_factory=list)
    guarantees: list[tree.Expr] = field(default_factory=list)
    once: dict[str, Any] = field(default_factory=dict)
    first: dict[str, Span] = field(default_factory=dict)


@dataclass(slots=True)
class _OnceParts:
    """A body whose items stand at most once each."""

    once: dict[str, Any] = field(default_factory=dict)
    first: dict[str, Span] = field(default_factory=dict)


@dataclass(slots=True)
class _VerifyParts:
    grid: list[tree.GridAxis] = field(default_factory=list)
    abstracts: list[tuple[tree.Name, tuple[tree.Abstraction, ...]]] = field(default_factory=list)
    once: dict[str, Any] = field(default_factory=dict)
    first: dict[str, Span] = field(default_factory=dict)


@dataclass(slots=True)
class _PlantParts:
    extern: bool = False
    reads: list[tree.Ref] = field(default_factory=list)
    drives: list[tuple[tree.Ref, tree.Expr | None]] = field(default_factory=list)
    states: list[tree.PlantState] = field(default_factory=list)
    disturbances: list[tree.Disturbance] = field(default_factory=list)
    lets: list[tree.PlantLet] = field(default_factory=list)
    der: list[tuple[tree.Name, tree.Expr]] = field(default_factory=list)
    next: list[tuple[tree.Name, tree.Expr]] = field(default_factory=list)
    measured: list[tuple[tree.Path, tree.Expr]] = field(default_factory=list)
    once: dict[str, Any] = field(default_factory=dict)
    first: dict[str, Span] = field(default_factory=dict)


@dataclass(slots=True)
class _SystemParts:
    instances: list[tree.Instance] = field(default_factory=list)
    properties: list[tree.Property] = field(default_factory=list)
    forces: list[tree.Force] = field(default_factory=list)
    replaces: list[tree.Replace] = field(default_factory=list)
    sets: list[tree.SetParam] = field(default_factory=list)
    inputs: list[tree.DriveInput] = field(default_factory=list)
    once: dict[str, Any] = field(default_factory=dict)
    first: dict[str, Span] = field(default_factory=dict)


class Parser(StatementParser):
    """The whole parser: files, declarations and their bodies."""

    __slots__ = ("broken", "declared", "edition")

    # ------------------------------------------------------------ files

    def file(self) -> tree.File:
        """`program` of the grammar."""
        self.broken: set[str] = set()
        self.declared: tree.Name | None = None
        self.edition: int | None = None
        imports: list[tree.ImportDecl] = []
        declarations: list[tree.Decl] = []
        reached = 0
        try:
            self._edition_line()
            while self.kinds[self.i] != EOF:
                reached = self.starts[self.i]
                declaration = self._top_level()
                if isinstance(declaration, tree.ImportDecl):
                    if declarations:
                        self._late_import(declaration, declarations[0])
                    imports.append(declaration)
                elif declaration is not None:
                    declarations.append(declaration)
        except TooManyErrorsError:
            self.tokens.truncated = True
        if self.tokens.truncated:
            # What was not read may have declared any of its words.
            self.broken.update(re.findall(r"[A-Za-z_]\w*", self.source.text[reached:]))
        span = Span(self.source, 0, len(self.source.text))
        return tree.File(
            self.edition, tuple(imports), tuple(declarations), span, frozenset(self.broken)
        )

    def _edition_line(self) -> None:
        first = f"`soter {EDITION};`"
        if self.kinds[0] != "soter":
            found = f", found {self.found()}"
            self.report(
                "S001",
                f"a file begins with {first}{found}",
                notes=("the first line names the edition of the language",),
                helps=(f"put {first} before everything else",),
            )
            self.quiet = -1
            return
        self.i = 1
        if self.kinds[1] == INT:
            if self.texts[1] == str(EDITION):
                self.edition = EDITION
            else:
                self.report(
                    "S002",
                    f"there is no edition `{visible(self.texts[1])}` of Soter",
                    label=f"this compiler reads edition {EDITION}",
                )
            self.i = 2
        else:
            self.report("S001", f"expected the number of the edition, found {self.found()}",
                        helps=(f"write {first}",))  # fmt: skip
            if self.kinds[1] not in (";", EOF) and not self.new_line():
                self.i = 2
        self.semicolon("the edition")

    def _top_level(self) -> tree.Decl | None:
        """One declaration, or one step past what is none."""
        i = self.i
        kind = self.kinds[i]
        parse = _DECLARATIONS.get(kind)
        if parse is not None:
            return self._declaration(parse)
        if kind == NAME and self.texts[i] == "input" and self.kinds[i + 1] == "topic":
            return self._declaration(Parser._topic)
        if kind == ";":
            self.stray_semicolon()
        elif kind == "}":
            self._unmatched()
        elif kind == "soter":
            self.report("S001", "`soter` stands only once, at the very beginning of the file")
            self.skip_statement()
        else:
            return self._no_declaration(kind)
        return None

    def _declaration(self, parse: Callable[[Parser], tree.Decl]) -> tree.Decl | None:
        before = self.i
        self.damaged = False
        self.declared = None
        self.depth = self.blocks = 0
        result: tree.Decl | None = None
        try:
            result = parse(self)
        except Panic:
            self.damaged = True
            if self.i == before:
                self.advance()
            self.skip_to_declaration()
        if self.damaged and self.declared is not None:
            self.broken.add(self.declared.text)
        return result

    def declare(self, what: str) -> tree.Name:
        """The name of the declaration at hand."""
        self.declared = self.name(what)
        return self.declared

    def _unmatched(self) -> None:
        self.report(
            "S013",
            "this `}` closes nothing",
            notes=("the declaration above is already complete: is there one `}` too many in it?",),
        )
        while self.kinds[self.i] in ("}", ";"):
            self.i += 1
        if self.kinds[self.i] not in _DECLARATIONS:
            self.skip_to_declaration()

    def _no_declaration(self, kind: str) -> tree.Decl | None:
        i = self.i
        word = self.texts[i]
        message = f"expected a declaration, found {self.found()}"
        helps: tuple[str, ...] = ()
        notes: tuple[str, ...] = ()
        if kind == NAME and self.kinds[i + 1] in (NAME, "fun", "node", "plant", "topic", STRING):
            near = "fun" if word in _FOREIGN_FUN else self.close_word(word, _DECLARATIONS)
            if near is not None and word not in _FOREIGN_DECLARATION:
                self.report("S009", message, helps=(f"did you mean `{near}`?",))
                self.quiet = -1
                return self._declaration(_DECLARATIONS[near])
        if word in _FOREIGN_DECLARATION:
            helps = (_FOREIGN_DECLARATION[word],)
        elif kind in STATEMENT_WORDS:
            notes = ("statements stand inside `step { ... }` or a function",)
        elif kind in _BODY_ITEM:
            notes = (f"`{kind}` belongs in a body: is there one `}}` too many above?",)
        elif kind in (NAME, "enum"):
            notes = ("declarations begin with " + ", ".join(f"`{w}`" for w in _SHOWN_WORDS),)
        self.report("S009", message, notes=notes, helps=helps)
        if self.kinds[i + 1] == NAME:
            self.broken.add(self.texts[i + 1])
        self.i = i + 1
        self.skip_to_declaration()
        return None

    def _late_import(self, late: tree.ImportDecl, first: tree.Decl) -> None:
        self.quiet = -1
        self.report(
            "S003",
            "imports stand before all declarations",
            late.span,
            also=((first.name.span, "the first declaration"),),
            helps=("move the import to the top of the file",),
        )
        self.quiet = -1

    # ------------------------------------------------------------ simple declarations

    def _import(self) -> tree.Decl:
        start = self.i
        self.i += 1
        at = self.i
        if self.kinds[at] != STRING:
            self.fail("S005", f"expected the name of a file after `import`, found {self.found()}",
                      helps=('write `import "file.soter" as name;`',))  # fmt: skip
        path = string_value(self.texts[at])
        stem = PurePosixPath(path).stem
        self.i += 1
        if self.accept("as"):
            name = self.declare("a name after `as`")
        else:
            guess = f" {stem}" if stem.isidentifier() else " name"
            self.report("S005", f"expected `as` after the file, found {self.found()}",
                        self.after_previous(), "the name it gets here is missing",
                        helps=(f"write `import {self.texts[at]} as{guess};`",))  # fmt: skip
            if self.kinds[self.i] == NAME and not self.new_line():
                name = self.declare("a name")
            else:
                name = self.declared = tree.Name(stem, self.token_span(at))
            self.damaged = True
        self.semicolon("the import")
        return tree.ImportDecl(
            name, self.span_from(self.starts[start]), path, self.token_span(at)
        )

    def _type_declaration(self) -> tree.Decl:
        start = self.starts[self.i]
        self.i += 1
        name = self.declare("the name of the type")
        if self.kinds[self.i] == "{":
            self.report("S005", "expected `=` after the name of the type, found `{`",
                        helps=(f"write `type {visible(name.text)} = {{ ... }};`",))  # fmt: skip
        else:
            self.assign("after the name of the type")
        type_ = self._enum() if self.kinds[self.i] == "enum" else self.type("a type")
        self.semicolon("the type")
        return tree.TypeDecl(name, self.span_from(start), type_)

    def _enum(self) -> tree.TypeExpr:
        start = self.starts[self.i]
        self.i += 1
        opener = self.i
        members: list[tree.Name] = []
        try:
            self.expect("{", "after `enum`")
            while True:
                members.append(self.name("the name of a member"))
                if self.kinds[self.i] == "=":
                    self.fail("S005", "expected `,` or `}` after the member, found `=`",
                              notes=("members have no numbers of their own",))  # fmt: skip
                if not self.comma("}", "the member", opener):
                    break
        except Panic:
            self.damaged = True
            self.skip_expression(opener)
        return tree.EnumTypeExpr(self.span_from(start), tuple(members))

    def _typed(self, what: str) -> tree.TypeExpr:
        """`: type` behind the name of `what`."""
        if self.accept(":"):
            return self.type(f"the type of {what}")
        self.report(
            "S005",
            f"expected `:` and a type after the name of {what}, found {self.found()}",
            self.after_previous(),
            "the type is missing here",
        )
        return tree.ErrorTypeExpr(self.after_previous())

    def _const(self) -> tree.Decl:
        start = self.starts[self.i]
        self.i += 1
        name = self.declare("the name of the constant")
        type_ = self._typed("the constant")
        data: str | None = None
        data_span: Span | None = None
        value: tree.Expr | None = None
        self.assign("after the type of the constant")
        if self.is_word("data") and self.kinds[self.i + 1] == STRING:
            data_span = self.token_span(self.i + 1)
            data = string_value(self.texts[self.i + 1])
            self.i += 2
            self.semicolon("the data file")
        else:
            value = self.value("the value of the constant")
        return tree.ConstDecl(name, self.span_from(start), type_, value, data, data_span)

    def _param(self) -> tree.Decl:
        start = self.starts[self.i]
        self.i += 1
        name = self.declare("the name of the parameter")
        type_ = self._typed("the parameter")
        self.assign("after the type of the parameter")
        default = self.expr("the default of the parameter")
        interval = self._interval("the range of the parameter") if self.accept("in") else None
        self.semicolon("the parameter")
        return tree.ParamDecl(name, self.span_from(start), type_, default, interval)

    def _interval(self, what: str) -> tree.Interval:
        """An interval, made of errors where it cannot be read."""
        start = self.i
        try:
            return self.interval(what)
        except Panic:
            self.depth = 0
            self._skip_interval(start)
            span = self.span_from(self.starts[start])
            return tree.Interval(tree.ErrorExpr(span), tree.ErrorExpr(span), span)

    def _skip_interval(self, start: int) -> None:
        """Past the `]` that closes the interval, if it comes before the item ends."""
        level = self.kinds[start : self.i].count("[") - self.kinds[start : self.i].count("]")
        while self.kinds[self.i] not in (";", "}", "{", EOF, "=") and not self.at_declaration():
            kind = self.kinds[self.i]
            level += (kind == "[") - (kind == "]")
            self.i += 1
            if kind == "]" and level <= 0:
                break
        self.quiet = self.i

    def _topic(self) -> tree.Decl:
        start = self.starts[self.i]
        is_input = self.accept_word("input")
        self.i += 1
        name = self.declare("the name of the topic")
        type_ = self._typed("the topic")
        values: tree.ValueSet | None = None
        default: tree.Expr | None = None
        max_age: tree.Expr | None = None
        order = 0
        while True:
            at = self.i
            if self.accept("in"):
                position, values = 1, self._value_set()
            elif self.kinds[at] in ("=", ":="):
                self.assign("before the default of the topic")
                position, default = 2, self.expr("the default of the topic")
            elif self.accept_word("max_age"):
                position, max_age = 3, self.time("`max_age`")
            else:
                break
            if position <= order:
                self._out_of_order(at, position == order)
            order = max(order, position)
        self.semicolon("the topic")
        span = self.span_from(start)
        return tree.TopicDecl(name, span, is_input, type_, values, default, max_age)

    def _out_of_order(self, at: int, again: bool) -> None:
        word = self.texts[at]
        self.quiet = -1
        span = self.token_span(at)
        if again:
            self.report("S022", f"`{word}` stands twice in this topic", span)
        else:
            self.report("S005", f"`{word}` stands too late in this topic", span,
                        notes=("the order is: `in` values, `=` default, `max_age`",))  # fmt: skip
        self.quiet = -1

    def _value_set(self) -> tree.ValueSet:
        start = self.i
        try:
            return self.value_set()
        except Panic:
            self.depth = 0
            if self.kinds[start] == "{":
                self.i = start
                self.skip_braces()
            else:
                self._skip_interval(start)
            span = self.span_from(self.starts[start])
            return tree.Interval(tree.ErrorExpr(span), tree.ErrorExpr(span), span)

    # ------------------------------------------------------------ functions

    def _fun(self) -> tree.Decl:
        start = self.starts[self.i]
        extern = self.accept("extern")
        self.i += 1
        name = self.declare("the name of the function")
        parameters = self._parameters()
        result = self._result_type(name)
        source, source_span = self._from() if extern else (None, None)
        body: tree.Block | None = None
        if self.kinds[self.i] == "{":
            if extern:
                self._extern_body(name)
            else:
                body = self.block("after the result type")
        elif extern:
            self.semicolon("the extern function")
        else:
            body = self._function_body()
        return tree.FunDecl(
            name, self.span_from(start), parameters, result, body, extern, source, source_span
        )

    def _function_body(self) -> tree.Block | None:
        """A function without its `{`."""
        message = f"expected `{{` and the body of the function, found {self.found()}"
        if self.kinds[self.i] == ";":
            self.report("S005", message,
                        helps=("a function written elsewhere is an `extern fun`",))  # fmt: skip
            self.i += 1
            return None
        self.report("S005", message)
        self.damaged = True
        start = self.i
        while self.kinds[self.i] not in ("{", ";", "}", EOF) and not self.at_declaration():
            self.i += 1
        if self.kinds[self.i] == "{":
            return self.block("after the result type")
        self.accept(";")
        del start
        return None

    def _extern_body(self, name: tree.Name) -> None:
        self.report("S025", f"the extern function `{visible(name.text)}` has a body",
                    helps=("leave out `extern`, or write `;` instead of the body",))  # fmt: skip
        self.block("after the result type")

    def _result_type(self, name: tree.Name) -> tree.TypeExpr:
        if self.kinds[self.i] in ("->", "=>"):
            self.report("S015", f"expected `:` before the result type, found {self.found()}",
                        helps=("the result type stands behind `:`",))  # fmt: skip
            self.i += 1
            return self.type("the result type")
        if self.accept(":"):
            return self.type("the result type")
        self.report(
            "S005",
            f"expected `:` and the result type of `{visible(name.text)}`, found {self.found()}",
            self.after_previous(),
            "the result type is missing here",
            notes=("a function computes a value: it always has a result type",),
        )
        return tree.ErrorTypeExpr(self.after_previous())

    def _parameters(self) -> tuple[tuple[tree.Name, tree.TypeExpr], ...]:
        opener = self.i
        self.expect("(", "after the name of the function")
        parameters: list[tuple[tree.Name, tree.TypeExpr]] = []
        if self.accept(")"):
            return ()
        try:
            while True:
                parameters.append(self._parameter())
                kind = self.kinds[self.i]
                if kind == ")":
                    self.i += 1
                    break
                if kind == "," and self.kinds[self.i + 1] != ")":
                    self.i += 1
                    continue
                also = ((self.token_span(opener), "opened here"),)
                message = f"expected `,` or `)` after the parameter, found {self.found()}"
                if kind == ",":
                    self.i += 1
                    message = "expected a parameter after `,`, found `)`"
                    self.report("S005", message)
                    self.i += 1
                    break
                self.fail("S005", message, also=also)
        except Panic:
            self.damaged = True
            while self.kinds[self.i] not in (")", "{", ";", "}", EOF):
                self.i += 1
            self.quiet = self.i
            self.accept(")")
        return tuple(parameters)

    def _parameter(self) -> tuple[tree.Name, tree.TypeExpr]:
        i = self.i
        if self.kinds[i + 1] == NAME and self.kinds[i] in ("float", "int", "bool", NAME):
            written = f"{self.texts[i + 1]}: {self.texts[i]}"
            self.report(
                "S005",
                f"expected `:` after the name of the parameter, found `{self.texts[i + 1]}`",
                self.token_span(i),
                helps=(f"the name comes first: write `{visible(written)}`",),
            )
            self.i += 1
            name = self.name("the name of a parameter")
            return name, tree.ErrorTypeExpr(name.span)
        name = self.name("the name of a parameter")
        return name, self._typed(f"the parameter `{visible(name.text)}`")

    def _from(self) -> tuple[str | None, Span | None]:
        """`from "..."` of an extern declaration, if it is there."""
        if not self.accept_word("from"):
            return None, None
        i = self.i
        if self.kinds[i] != STRING:
            self.report("S005", f"expected a string after `from`, found {self.found()}",
                        helps=('write `from "python:policy.py:step"`',))  # fmt: skip
            self.damaged = True
            return None, None
        self.i += 1
        return string_value(self.texts[i]), self.token_span(i)

    def _extern(self) -> tree.Decl:
        following = self.kinds[self.i + 1]
        if following == "fun":
            return self._fun()
        if following == "node":
            return self._node()
        if following == "plant":
            return self._plant()
        self.i += 1
        if self.kinds[self.i + 1] == NAME and self.kinds[self.i] in (NAME, "topic", "rta"):
            self.broken.add(self.texts[self.i + 1])
        self.fail("S005", "expected `fun`, `node` or `plant` after `extern`, "
                          f"found {self.found()}")  # fmt: skip

    # ------------------------------------------------------------ bodies

    def _open_body(self, what: str, items: Mapping[str, object]) -> int:
        """The `{` of a body, or the token that stands in its place."""
        if self.kinds[self.i] == "{":
            self.opened.append(self.i)
            self.i += 1
            return self.i - 1
        self.report("S005", f"expected `{{` to begin the body of {what}, found {self.found()}")
        if self.texts[self.i] not in items:
            self.damaged = True
            self.skip_expression(self.i, stop_at_brace=True)
            if self.kinds[self.i] == "{":
                self.opened.append(self.i)
                self.i += 1
                return self.i - 1
            if self.texts[self.i] not in items:
                raise Panic
        return self.i - 1

    def _body(
        self,
        what: str,
        parts: _Parts,
        items: Mapping[str, Callable[[Parser, _Parts], None]],
        other: Callable[[_Parts], bool] | None = None,
    ) -> None:
        """`{ items }`: one method per leading word; `other` tries what has none."""
        opener = self._open_body(what, items)
        while True:
            kind = self.kinds[self.i]
            if kind == "}":
                self.i += 1
                return
            if kind == EOF or self.at_declaration():
                self.damaged = True
                self.unclosed(opener, what)
                return
            if kind == ";":
                self.stray_semicolon()
                continue
            before = self.i
            try:
                if other is None or not other(parts):
                    item = items.get(self.texts[before])
                    if item is not None:
                        item(self, parts)
                    else:
                        self._unknown_item(what, parts, items)
            except Panic:
                self.damaged = True
                self.depth = self.blocks = 0
                if self.i == before:
                    self.advance()
                self.skip_statement()

    def _unknown_item(
        self,
        what: str,
        parts: _Parts,
        items: Mapping[str, Callable[[Parser, _Parts], None]],
    ) -> None:
        word, kind = self.texts[self.i], self.kinds[self.i]
        message = f"expected an item of {what}, found {self.found()}"
        if kind in STATEMENT_WORDS and not (kind == "publish" and self._only_names()):
            self.report("S010", message, notes=("statements stand inside a `step { ... }` block",))
            self.quiet = -1
            self.damaged = True
            self._recovering([], kind)
            return
        near = self.close_word(word, items) if word.isidentifier() else None
        if near is not None:
            self.report("S010", message, helps=(f"did you mean `{near}`?",))
            self.quiet = -1
            items[near](self, parts)
            return
        homes = [home for home, words in _HOMES.items() if word in words and words is not items]
        known = ", ".join(f"`{w}`" for w in items)
        notes = (f"the items of {what.split(' `')[0]} are {known}",)
        if homes:
            notes = (f"`{word}` belongs in {' or '.join(homes)}",)
        self.fail("S010", message, notes=notes)

    def _only_names(self) -> bool:
        """Whether `publish` is followed by names only, so that `publishes` is meant."""
        i = self.i + 1
        while self.kinds[i] in (NAME, ".", ","):
            i += 1
        return self.kinds[i] in (";", "}") or self.kinds[i] in _BODY_ITEM

    def _once(self, parts: Any, what: str, value: object, at: int) -> None:  # noqa: ANN401
        """Keep the value of an item that may stand once; report the second."""
        span = self.token_span(at)
        if what in parts.first:
            self.quiet = -1
            also = ((parts.first[what], "the first one"),)
            self.report("S022", f"`{what}` stands twice in this body", span, "again", also=also)
            self.quiet = -1
            return
        parts.first[what] = span
        parts.once[what] = value

    def _refs(self, what: str) -> list[tree.Ref]:
        refs = [self.ref(what)]
        while self.accept(","):
            refs.append(self.ref(what))
        return refs

    def _period(self, what: str, name: tree.Name) -> tree.Expr:
        word = self.texts[self.i]
        if word == "period":
            self.i += 1
            return self.time("`period`")
        example = f"write `{what} {visible(name.text)} period 10ms {{ ... }}`"
        message = f"expected `period` after the name of the {what}, found {self.found()}"
        span = self.after_previous() if self.kinds[self.i] == "{" else None
        self.report("S005", message, span, helps=(example,))
        if self.kinds[self.i] == NAME and self.kinds[self.i + 1] != "{" and word != "from":
            self.i += 1
            self.quiet = -1
            return self.time("`period`")
        return tree.ErrorExpr(self.after_previous())

    # ------------------------------------------------------------ nodes

    def _node(self) -> tree.Decl:
        start = self.starts[self.i]
        extern = self.accept("extern")
        self.i += 1
        name = self.declare("the name of the node")
        period = self._period("node", name)
        phase = self.time("`phase`") if self.accept("phase") else None
        source, source_span = self._from() if extern else (None, None)
        parts = _NodeParts()
        what = f"node `{visible(name.text)}`"
        self._body(what, parts, _NODE_ITEMS)
        step = parts.once.get("step")
        if extern and step is not None:
            self._misplaced("S025", f"the extern {what} has a `step`", parts.first["step"],
                            "leave out `extern`, or the step")  # fmt: skip
            step = None
        if not extern and step is None and not self.damaged:
            self._misplaced("S024", f"{what} has no `step`", name.span,
                            "add `step { ... }`, or declare it `extern node`")  # fmt: skip
            self.damaged = True
        return tree.NodeDecl(
            name, self.span_from(start), period, phase, extern, source, source_span,
            tuple(parts.subscribes), tuple(parts.publishes), tuple(parts.failsafe),
            tuple(parts.locals), tuple(parts.assumes), tuple(parts.guarantees),
            parts.once.get("on takeover"), step,
        )  # fmt: skip

    def _misplaced(self, code: str, message: str, span: Span, help_: str) -> None:
        quiet, self.quiet = self.quiet, -1
        self.report(code, message, span, helps=(help_,))
        self.quiet = quiet

    def _subscribes(self, parts: _NodeParts) -> None:
        self.i += 1
        while True:
            start = self.starts[self.i]
            topic = self.ref("the name of a topic")
            queue: int | None = None
            policy: str | None = None
            if self.accept_word("queue"):
                queue = self._count("the length of the queue")
                if self.kinds[self.i] == NAME and not self.new_line():
                    policy = self._policy()
            span = self.span_from(start)
            parts.subscribes.append(tree.Subscription(topic, queue, policy, span))
            if not self.accept(","):
                break
        self.semicolon("the subscriptions")

    def _count(self, what: str) -> int | None:
        i = self.i
        if self.kinds[i] == INT and len(self.texts[i]) <= 9:
            self.i += 1
            return int(self.texts[i])
        if self.kinds[i] in (INT, ERROR):
            self.report("L005", f"this number is too large for {what}")
            self.i += 1
            return None
        self.fail("S005", f"expected {what} as a whole number, found {self.found()}")

    def _policy(self) -> str | None:
        words = ("drop_oldest", "drop_newest", "fault")
        word = self.texts[self.i]
        if word in words:
            self.i += 1
            return word
        self.report("S005", f"expected `;` or what a full queue does, found {self.found()}",
                    helps=("the policies are `drop_oldest`, `drop_newest` and `fault`",))  # fmt: skip
        self.i += 1
        return None

    def _publishes(self, parts: _NodeParts) -> None:
        self.i += 1
        parts.publishes.extend(self._refs("the name of a topic"))
        self.semicolon("the published topics")

    def _failsafe(self, parts: _NodeParts) -> None:
        self.i += 1
        topic = self.ref("the name of a topic")
        self.assign("after the topic of `failsafe`")
        parts.failsafe.append((topic, self.value("the fail-safe value")))

    def _local(self, parts: _NodeParts) -> None:
        start = self.starts[self.i]
        self.i += 1
        name = self.name("a name after `var`")
        type_ = self._typed("the variable")
        initial: tree.Expr | None = None
        if self.kinds[self.i] in ("=", ":=", "=="):
            self.assign("after the type of the variable")
            initial = self.value("the initial value")
        else:
            self.semicolon("the variable")
        parts.locals.append(tree.LocalVar(name, type_, initial, self.span_from(start)))

    def _assumes(self, parts: _NodeParts) -> None:
        self.i += 1
        parts.assumes.append(self.value("the assumption"))

    def _guarantees(self, parts: _NodeParts) -> None:
        self.i += 1
        parts.guarantees.append(self.value("the guarantee"))

    def _on(self, parts: _NodeParts) -> None:
        at = self.i
        self.i += 1
        self.expect_word("takeover", "after `on`")
        self._once(parts, "on takeover", self.block("after `on takeover`"), at)

    def _step(self, parts: _NodeParts) -> None:
        at = self.i
        self.i += 1
        self._once(parts, "step", self.block("after `step`"), at)

    # ------------------------------------------------------------ modules

    def _rta(self) -> tree.Decl:
        start = self.starts[self.i]
        self.i += 1
        name = self.declare("the name of the module")
        parts = _OnceParts()
        self._body(f"module `{visible(name.text)}`", parts, _RTA_ITEMS)
        once = parts.once.get
        return tree.RtaDecl(
            name, self.span_from(start), once("ac"), once("sc"), once("period"), once("safe"),
            once("safer"), once("ttf"), once("clean"), once("verify"),
        )  # fmt: skip

    def _controller(self, parts: _OnceParts) -> None:
        at = self.i
        word = self.texts[at] if self.texts[at] in ("ac", "sc") else "ac"
        self.i += 1
        node = self.ref(f"the name of a node after `{word}`")
        self.semicolon(f"the node of `{word}`")
        self._once(parts, word, node, at)

    def _module_period(self, parts: _OnceParts) -> None:
        at = self.i
        self.i += 1
        self._once(parts, "period", self.time_value("`period`"), at)

    def _verify(self, parts: _OnceParts) -> None:
        at = self.i
        self.i += 1
        inner = _VerifyParts()
        self._body("this `verify` block", inner, _VERIFY_ITEMS)
        block = tree.VerifyBlock(
            tuple(inner.grid),
            tuple(inner.abstracts),
            inner.once.get("horizon"),
            inner.once.get("levels"),
            self.span_from(self.starts[at]),
        )
        self._once(parts, "verify", block, at)

    def _grid(self, parts: _VerifyParts) -> None:
        self.i += 1
        while True:
            path = self.path("a topic or one of its fields")
            self.expect("in", "after the axis")
            interval = self._interval("the range of the axis")
            self.expect("/", "and the number of cells after the range of the axis")
            cells = self.expr("the number of cells")
            parts.grid.append(tree.GridAxis(path, interval, cells))
            if not self.accept(","):
                break
        self.semicolon("the grid")

    def _abstracts(self, parts: _VerifyParts) -> None:
        self.i += 1
        name = self.name("the name of a plant after `abstracts`")
        self.expect_word("by", "after the abstracted plant")
        pairs: list[tree.Abstraction] = []
        while True:
            instance = self.name("the name of an abstraction")
            self.expect(":", "after the name of the abstraction")
            plant = self.ref("the name of a plant")
            self.assign("after the abstract plant")
            value = self.expr("the abstract state")
            pairs.append(tree.Abstraction(instance, plant, value))
            if not self.accept(","):
                break
        parts.abstracts.append((name, tuple(pairs)))
        self.semicolon("the abstractions")

    # ------------------------------------------------------------ plants

    def _plant(self) -> tree.Decl:
        start = self.starts[self.i]
        extern = self.accept("extern")
        self.i += 1
        name = self.declare("the name of the plant")
        period = self._period("plant", name)
        source, source_span = self._from() if extern else (None, None)
        parts = _PlantParts(extern)
        self._body(f"plant `{visible(name.text)}`", parts, _PLANT_ITEMS)
        return tree.PlantDecl(
            name, self.span_from(start), period, extern, source, source_span,
            tuple(parts.reads), tuple(parts.drives), tuple(parts.states),
            tuple(parts.disturbances), tuple(parts.lets), tuple(parts.der), tuple(parts.next),
            parts.once.get("integrate"), tuple(parts.measured),
        )  # fmt: skip

    def _reads(self, parts: _PlantParts) -> None:
        self.i += 1
        parts.reads.extend(self._refs("the name of a topic"))
        self.semicolon("the read topics")

    def _drives(self, parts: _PlantParts) -> None:
        self.i += 1
        topic = self.ref("the name of a topic")
        value: tree.Expr | None = None
        if self.kinds[self.i] in ("=", ":=", "=="):
            self.assign("after the driven topic")
            value = self.value("the driven value")
        elif self.kinds[self.i] == ",":
            self.report("S005", "expected `;` after the driven topic, found `,`",
                        helps=("write one `drives` for each topic",))  # fmt: skip
            self.damaged = True
            self.skip_statement()
        elif parts.extern:
            self.semicolon("the driven topic")
        else:
            self.report(
                "S005",
                f"expected `=` and a value after the driven topic, found {self.found()}",
                helps=("only an extern plant drives a topic without saying what",),
            )
            value = tree.ErrorExpr(topic.span)
            self.skip_statement()
        parts.drives.append((topic, value))

    def _state(self, parts: _PlantParts) -> None:
        start = self.starts[self.i]
        self.i += 1
        name = self.name("the name of a state")
        type_ = self._typed("the state")
        interval = self._interval("the initial range") if self.accept("in") else None
        initial: tree.Expr | None = None
        if self.kinds[self.i] in ("=", ":=", "=="):
            self.assign("before the initial value")
            initial = self.value("the initial value")
        else:
            self.semicolon("the state")
        span = self.span_from(start)
        parts.states.append(tree.PlantState(name, type_, interval, initial, span))

    def _disturbance(self, parts: _PlantParts) -> None:
        start = self.starts[self.i]
        self.i += 1
        name = self.name("the name of a disturbance")
        type_ = self._typed("the disturbance")
        hold: tree.Expr | None = None
        if self.kinds[self.i] != "in" and isinstance(type_, tree.RangedIntType):
            # `int in [a, b]` reads as a type first; here the range is the disturbance's.
            interval = type_.interval
            type_ = tree.BuiltinType(type_.span, "int")
        elif self.accept("in"):
            interval = self._interval("the range of the disturbance")
        else:
            message = f"expected `in` and a range after the disturbance, found {self.found()}"
            self.report("S005", message, notes=("a proof needs the bound of every disturbance",))
            error = tree.ErrorExpr(self.after_previous())
            interval = tree.Interval(error, error, error.span)
        if self.accept_word("hold"):
            hold = self.time("`hold`")
        self.semicolon("the disturbance")
        span = self.span_from(start)
        parts.disturbances.append(tree.Disturbance(name, type_, interval, hold, span))

    def _plant_let(self, parts: _PlantParts) -> None:
        statement = self._let()
        if isinstance(statement, tree.LetStmt):
            parts.lets.append(
                tree.PlantLet(statement.name, statement.type, statement.value, statement.span)
            )

    def _der(self, parts: _PlantParts) -> None:
        parts.der.append(self._equation("der"))

    def _next(self, parts: _PlantParts) -> None:
        parts.next.append(self._equation("next"))

    def _equation(self, word: str) -> tuple[tree.Name, tree.Expr]:
        self.i += 1
        name = self.name(f"the name of a state after `{word}`")
        start = self.i
        try:
            self.assign("after the state")
        except Panic:
            self.skip_expression(start)
            self.accept(";")
            return name, tree.ErrorExpr(self.after_previous())
        return name, self.value("the equation")

    def _integrate(self, parts: _PlantParts) -> None:
        at = self.i
        self.i += 1
        method = self.texts[self.i]
        if method not in ("rk4", "euler"):
            self.fail("S005", f"expected `rk4` or `euler` after `integrate`, found {self.found()}")
        self.i += 1
        substeps = self.expr("the number of substeps") if self.accept_word("substeps") else None
        self.semicolon("the method of integration")
        self._once(parts, "integrate", (method, substeps), at)

    def _measured(self, parts: _PlantParts) -> None:
        self.i += 1
        while True:
            path = self.path("a topic or one of its fields")
            self.expect_word("within", "after the measured value")
            parts.measured.append((path, self.expr("the bound of the error")))
            if not self.accept(","):
                break
        self.semicolon("the measurement bounds")

    # ------------------------------------------------------------ systems and tests

    def _system(self) -> tree.Decl:
        start = self.starts[self.i]
        self.i += 1
        name = self.declare("the name of the system")
        default = self.accept_word("default")
        parts = _SystemParts()
        what = f"system `{visible(name.text)}`"
        self._body(what, parts, _SYSTEM_ITEMS, self._instance)
        return tree.SystemDecl(
            name, self.span_from(start), default, tuple(parts.instances),
            parts.once.get("until"), tuple(parts.properties), tuple(parts.forces),
            tuple(parts.replaces), tuple(parts.sets), tuple(parts.inputs),
        )  # fmt: skip

    def _instance(self, parts: _SystemParts) -> bool:
        """`name: What;` if that stands here."""
        if self.kinds[self.i + 1] != ":":
            return False
        start = self.starts[self.i]
        name = self.name("the name of an instance")
        self.i += 1
        what = self.ref("what the instance is made of")
        renames = self._renames_of(what)
        self.semicolon("the instance")
        parts.instances.append(tree.Instance(name, what, None, renames, self.span_from(start)))
        return True

    def _use(self, parts: _SystemParts) -> None:
        start = self.starts[self.i]
        kind = "node" if self.texts[self.i] == "node" else "module"
        self.i += 1
        what = self.ref(f"the name of a {kind}")
        renames = self._renames_of(what)
        self.semicolon(f"the {kind}")
        instance = tree.Instance(what.name, what, kind, renames, self.span_from(start))
        parts.instances.append(instance)

    def _renames_of(self, what: tree.Ref) -> tuple[tuple[tree.Ref, tree.Ref], ...]:
        if self.kinds[self.i] != "{":
            return ()
        opener = self.i
        self.i += 1
        pairs: list[tuple[tree.Ref, tree.Ref]] = []
        while True:
            inner = self.ref(f"a topic of `{visible(what.text)}`")
            self.assign("between the two names of a topic")
            pairs.append((inner, self.ref("the name of a topic")))
            if not self.comma("}", "the renamed topic", opener):
                return tuple(pairs)

    def _until(self, parts: _SystemParts) -> None:
        at = self.i
        self.i += 1
        self._once(parts, "until", self.time_value("`until`"), at)

    def _always(self, parts: _SystemParts) -> None:
        start = self.starts[self.i]
        kind = "never" if self.texts[self.i] == "never" else "always"
        self.i += 1
        condition = self.value("the property")
        span = self.span_from(start)
        parts.properties.append(tree.Property(kind, None, condition, None, span))

    def _force(self, parts: _SystemParts) -> None:
        start = self.starts[self.i]
        self.i += 1
        module = self.path("the name of a module after `force`")
        to = self.texts[self.i]
        if to not in ("ac", "sc"):
            self.fail("S005", f"expected `ac` or `sc` after the module, found {self.found()}")
        self.i += 1
        self.semicolon("the forced mode")
        parts.forces.append(tree.Force(module, to, self.span_from(start)))

    def _replace(self, parts: _SystemParts) -> None:
        start = self.starts[self.i]
        self.i += 1
        what = self.path("the name of what is replaced")
        self.expect_word("by", "after what is replaced")
        by = self.ref("the name of the replacement")
        self.semicolon("the replacement")
        parts.replaces.append(tree.Replace(what, by, self.span_from(start)))

    def _set(self, parts: _SystemParts) -> None:
        start = self.starts[self.i]
        self.i += 1
        param = self.ref("the name of a parameter")
        self.assign("after the parameter")
        value = self.value("the value of the parameter")
        parts.sets.append(tree.SetParam(param, value, self.span_from(start)))

    def _input(self, parts: _SystemParts) -> None:
        start = self.starts[self.i]
        self.i += 1
        topic = self.path("the name of an input topic")
        self.expect_word("every", "after the input")
        every = self.time_value("`every`")
        parts.inputs.append(tree.DriveInput(topic, every, self.span_from(start)))

    def _test(self) -> tree.Decl:
        start = self.starts[self.i]
        self.i += 1
        name = self.declare("the name of the test")
        parts = _SystemParts()
        self._body(f"test `{visible(name.text)}`", parts, _TEST_ITEMS, self._leads_to)
        once = parts.once.get
        return tree.TestDecl(
            name, self.span_from(start), once("system"), tuple(parts.replaces), once("skew"),
            once("horizon"), tuple(parts.properties),
        )  # fmt: skip

    def _tested_system(self, parts: _SystemParts) -> None:
        at = self.i
        self.i += 1
        system = self.ref("the name of a system")
        self.semicolon("the system")
        self._once(parts, "system", system, at)

    def _test_time(self, parts: _SystemParts) -> None:
        at = self.i
        word = "horizon" if self.texts[at] == "horizon" else "skew"
        self.i += 1
        self._once(parts, word, self.time_value(f"`{word}`"), at)

    def _eventually(self, parts: _SystemParts) -> None:
        start = self.starts[self.i]
        self.i += 1
        condition = self.expr("the property")
        within = self._within()
        span = self.span_from(start)
        parts.properties.append(tree.Property("eventually", None, condition, within, span))

    def _leads_to(self, parts: _SystemParts) -> bool:
        """`premise leadsto condition within d;` if that stands here."""
        i = self.i
        kinds, texts = self.kinds, self.texts
        if texts[i] in _TEST_ITEMS and kinds[i + 1] not in (".", "<", "<=", "==", "&&", "||"):
            return False
        at = i
        while kinds[at] not in (";", "}", EOF) and texts[at] != "leadsto":
            at += 1
        if texts[at] != "leadsto":
            return False
        start = self.starts[i]
        premise = self.expr("the premise")
        self.expect_word("leadsto", "after the premise")
        condition = self.expr("the property")
        within = self._within()
        span = self.span_from(start)
        parts.properties.append(tree.Property("leadsto", premise, condition, within, span))
        return True

    def _within(self) -> tree.Expr:
        if self.accept_word("within"):
            return self.time_value("`within`")
        message = f"expected `within` and a time after the property, found {self.found()}"
        self.report("S005", message, self.after_previous(),
                    notes=("a property that may wait forever cannot be tested",))  # fmt: skip
        self.semicolon("the property")
        return tree.ErrorExpr(self.after_previous())


def _predicate(word: str, what: str) -> Callable[[Parser, Any], None]:
    """The parser of an item `word expr ;` that stands at most once."""

    def item(parser: Parser, parts: Any) -> None:  # noqa: ANN401
        at = parser.i
        parser.i += 1
        value = parser.value(what)
        parser._once(parts, word, value, at)  # noqa: SLF001

    return item


_DECLARATIONS: dict[str, Callable[[Parser], tree.Decl]] = {
    "import": Parser._import,
    "type": Parser._type_declaration,
    "const": Parser._const,
    "param": Parser._param,
    "fun": Parser._fun,
    "extern": Parser._extern,
    "topic": Parser._topic,
    "node": Parser._node,
    "rta": Parser._rta,
    "plant": Parser._plant,
    "system": Parser._system,
    "test": Parser._test,
}
_SHOWN_WORDS = tuple(word for word in _DECLARATIONS if word != "import")

_NODE_ITEMS: dict[str, Callable[[Parser, _NodeParts], None]] = {
    "subscribes": Parser._subscribes,
    "publishes": Parser._publishes,
    "failsafe": Parser._failsafe,
    "var": Parser._local,
    "assumes": Parser._assumes,
    "guarantees": Parser._guarantees,
    "on": Parser._on,
    "step": Parser._step,
}
_RTA_ITEMS: dict[str, Callable[[Parser, _OnceParts], None]] = {
    "ac": Parser._controller,
    "sc": Parser._controller,
    "period": Parser._module_period,
    "safe": _predicate("safe", "the safe condition"),
    "safer": _predicate("safer", "the safer condition"),
    "ttf": _predicate("ttf", "the ttf condition"),
    "clean": _predicate("clean", "the value of `clean`"),
    "verify": Parser._verify,
}
_VERIFY_ITEMS: dict[str, Callable[[Parser, _VerifyParts], None]] = {
    "grid": Parser._grid,
    "abstracts": Parser._abstracts,
    "horizon": _predicate("horizon", "the horizon"),
    "levels": _predicate("levels", "the levels"),
}
_PLANT_ITEMS: dict[str, Callable[[Parser, _PlantParts], None]] = {
    "reads": Parser._reads,
    "drives": Parser._drives,
    "state": Parser._state,
    "disturbance": Parser._disturbance,
    "let": Parser._plant_let,
    "der": Parser._der,
    "next": Parser._next,
    "integrate": Parser._integrate,
    "measured": Parser._measured,
}
_SYSTEM_ITEMS: dict[str, Callable[[Parser, _SystemParts], None]] = {
    "module": Parser._use,
    "node": Parser._use,
    "until": Parser._until,
    "always": Parser._always,
    "never": Parser._always,
    "force": Parser._force,
    "replace": Parser._replace,
    "set": Parser._set,
    "input": Parser._input,
}
_TEST_ITEMS: dict[str, Callable[[Parser, _SystemParts], None]] = {
    "system": Parser._tested_system,
    "replace": Parser._replace,
    "skew": Parser._test_time,
    "horizon": Parser._test_time,
    "always": Parser._always,
    "never": Parser._always,
    "eventually": Parser._eventually,
}
_HOMES: dict[str, Mapping[str, object]] = {
    "a node": _NODE_ITEMS,
    "an `rta`": _RTA_ITEMS,
    "a `verify` block": _VERIFY_ITEMS,
    "a plant": _PLANT_ITEMS,
    "a system": _SYSTEM_ITEMS,
    "a test": _TEST_ITEMS,
}
