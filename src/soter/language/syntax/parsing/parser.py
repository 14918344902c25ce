"""Parses whole files, declaration by declaration: from tokens to a tree.

Purpose: `parse(source, diagnostics)` makes one tree and reports every syntax error of the file in
one pass, in the order of the text. A declaration with a mistake keeps what could be read of it; its
name goes into `File.broken`, so that later passes do not report what is missing.
Non-goals: anything that needs another declaration or file (`language/load/`, `language/check/`).
"""

# ruff: noqa: SLF001 - the tables at the end name the methods of the class before them

from __future__ import annotations

import re
from pathlib import PurePosixPath
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostic, Label, Span
from soter.diagnostics.fixes import insert, replace
from soter.language.syntax import tree
from soter.language.syntax.lexer import EOF, INT, NAME, STRING, lex, printable, string_value
from soter.language.syntax.parsing.bodies import BodyParser
from soter.language.syntax.parsing.declarations import parse_fun, parse_node, parse_plant
from soter.language.syntax.parsing.items import clauses, equal, range_of, time
from soter.language.syntax.parsing.modules import parse_rta
from soter.language.syntax.parsing.systems import parse_system, parse_test
from soter.language.syntax.parsing.token_cursor import (
    BODY_WORDS,
    ERRORS_MAX,
    STATEMENT_WORDS,
    Panic,
    TooManyErrorsError,
)
from soter.language.syntax.parsing.types import parse_value_set, type_expression
from soter.language.syntax.their_words import THEIRS

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.diagnostics.diagnostic import Diagnostics, Help, Source
    from soter.language.syntax.parsing.items import Step

#: The language edition this compiler reads.
EDITION = 1


def parse(source: Source, diagnostics: Diagnostics) -> tree.File:
    """Parses one file; adds errors to `diagnostics`, and always gives a tree."""
    return parse_tokens(source, diagnostics)[0]


def parse_tokens(source: Source, diagnostics: Diagnostics) -> tuple[tree.File, Parser]:
    """Parses one file; gives the tree, and the parser with tokens and marks for the printer."""
    parser = Parser(lex(source))
    file = parser.file()
    problems = parser.tokens.problems + parser.problems
    problems.sort(key=lambda d: d.primary.span.start if d.primary else 0)
    for problem in problems[:ERRORS_MAX]:
        diagnostics.add(problem)
    if len(problems) >= ERRORS_MAX:
        diagnostics.add(_too_many_errors_diagnostic(problems[ERRORS_MAX - 1]))
    return file, parser


def _too_many_errors_diagnostic(last: Diagnostic) -> Diagnostic:
    primary = Label(last.primary.span, "the last error that is shown") if last.primary else None
    message = f"this file has {ERRORS_MAX} syntax errors or more"
    note = "the rest of the file was not read: is it a Soter file?"
    return Diagnostic("S021", message, primary, notes=(note,))


# ---------------------------------------------------------------- parts of a body


class Parser(BodyParser):
    """The parser of complete files with all their declarations."""

    __slots__ = ("edition",)

    # ------------------------------------------------------------ files

    def file(self) -> tree.File:
        """Parses a whole file (`program` in the grammar)."""
        self.edition: int | None = None
        self.broken.update(self.tokens.lost)
        imports: list[tree.ImportDecl] = []
        declarations: list[tree.Decl] = []
        reached = 0
        try:
            self._parse_edition()
            while self.kinds[self.i] != EOF:
                reached = self.starts[self.i]
                declaration = self._parse_top_level()
                if isinstance(declaration, tree.ImportDecl):
                    if declarations:
                        self._report_late_import(declaration, declarations[0])
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

    def _parse_edition(self) -> None:
        first = f"`soter {EDITION};`"
        if self.kinds[0] != "soter":
            suffix = f", found {self.found()}"
            self.report(
                "S001",
                f"a file begins with {first}{suffix}",
                notes=("the first line names the edition of the language",),
                helps=(
                    insert(
                        Span(self.source, 0, 0),
                        f"soter {EDITION};\n",
                        f"put {first} before everything else",
                    ),
                ),
                once=False,
            )
            return
        self.i = 1
        if self.kinds[1] == INT:
            if self.texts[1] == str(EDITION):
                self.edition = EDITION
            else:
                self.report(
                    "S002",
                    f"there is no edition `{printable(self.texts[1])}` of Soter",
                    label=f"this compiler reads edition {EDITION}",
                )
            self.i = 2
        else:
            self.report(
                "S001",
                f"expected the number of the edition, found {self.found()}",
                helps=(f"write {first}",),
            )
            if self.kinds[1] not in (";", EOF) and not self.is_on_new_line():
                self.i = 2
        self.expect_semicolon("the edition")

    def _parse_top_level(self) -> tree.Decl | None:
        """Parses one declaration, or skips a token that cannot begin a declaration."""
        self.items, self.blocks = frozenset(), 0
        i = self.i
        kind = self.kinds[i]
        parse = _DECLARATIONS.get(kind)
        if parse is not None:
            return self._declaration(parse)
        if kind == NAME and self.texts[i] == "input" and self.kinds[i + 1] == "topic":
            return self._declaration(Parser._parse_topic)
        if kind == ";":
            self.skip_stray_semicolons()
        elif kind == "}":
            self._report_unmatched()
        elif kind == "soter":
            self.report("S001", "`soter` stands only once, at the very beginning of the file")
            self.skip_statement()
        else:
            return self._parse_or_refuse(kind)
        return None

    def _declaration(self, parse: Callable[[Parser], tree.Decl]) -> tree.Decl | None:
        before = self.i
        self.damaged = False
        self.declared = None
        self.depth = self.blocks = 0
        self.items = frozenset()
        self.indent = self.line_indent(before)
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

    def _report_unmatched(self) -> None:
        self.report(
            "S013",
            "this `}` closes nothing",
            notes=("the declaration above is already complete: is there one `}` too many in it?",),
        )
        while self.kinds[self.i] in ("}", ";"):
            self.i += 1
        if self.kinds[self.i] not in _DECLARATIONS:
            self.skip_to_declaration()

    def _parse_or_refuse(self, kind: str) -> tree.Decl | None:
        i = self.i
        word = self.texts[i]
        message = f"expected a declaration, found {self.found()}"
        helps: tuple[Help, ...] = ()
        notes: tuple[str, ...] = ()
        if kind == NAME and self.kinds[i + 1] in (NAME, "fun", "node", "plant", "topic", STRING):
            near = None if word in THEIRS else self.word_close_to(word, _DECLARATIONS)
            if near is not None:
                helps = (replace(self.token_span(i), near, f"did you mean `{near}`?"),)
                self.report("S009", message, helps=helps, once=False)
                return self._declaration(_DECLARATIONS[near])
        if kind in STATEMENT_WORDS:
            notes = ("statements stand inside `step { ... }` or a function",)
        elif kind in BODY_WORDS:
            notes = (f"`{kind}` belongs in a body: is there one `}}` too many above?",)
        elif kind in (NAME, "enum"):
            notes = ("declarations begin with " + ", ".join(f"`{w}`" for w in _SHOWN_WORDS),)
        self.report("S009", message, notes=notes, helps=helps)
        if self.kinds[i + 1] == NAME:
            self.broken.add(self.texts[i + 1])
        self.i = i + 1
        self.skip_to_declaration()
        return None

    def _report_late_import(self, late: tree.ImportDecl, first: tree.Decl) -> None:
        self.quiet = -1
        self.report(
            "S003",
            "imports stand before all declarations",
            late.span,
            also=((first.name.span, "the first declaration"),),
            helps=("move the import to the top of the file",),
            once=False,
        )

    # ------------------------------------------------------------ simple declarations

    def _parse_import(self) -> tree.Decl:
        start = self.take()
        at = self.i
        if self.kinds[at] != STRING:
            raise self.failure(
                "S005",
                f"expected the name of a file after `import`, found {self.found()}",
                notes=('an import says a file and a name for it: `import "file.soter" as name;`',),
            )
        path = string_value(self.texts[at])
        stem = PurePosixPath(path).stem
        self.i += 1
        if self.accept("as"):
            name = self.declare("a name after `as`")
        else:
            guess = f" {stem}" if stem.isidentifier() else " name"
            self.report(
                "S005",
                f"expected `as` after the file, found {self.found()}",
                self.after_previous(),
                "the name it gets here is missing",
                helps=(f"write `import {self.texts[at]} as{guess};`",),
            )
            if self.kinds[self.i] == NAME and not self.is_on_new_line():
                if self.kinds[self.i + 1] == NAME:  # another word than `as`
                    self.i += 1
                name = self.declare("a name")
            else:
                name = self.declared = tree.Name(stem, self.token_span(at))
            self.damaged = True
        self.expect_semicolon("the import")
        return tree.ImportDecl(name, self.span_from(self.starts[start]), path, self.token_span(at))

    def _parse_type_declaration(self) -> tree.Decl:
        start = self.starts[self.take()]
        name = self.declare("the name of the type")
        if self.kinds[self.i] == "{":
            self.report(
                "S005",
                "expected `=` after the name of the type, found `{`",
                helps=(f"write `type {printable(name.text)} = {{ ... }};`",),
            )
        else:
            self.assign("after the name of the type")
        type_ = (
            self._parse_enum() if self.kinds[self.i] == "enum" else type_expression(self, "a type")
        )
        self.expect_semicolon("the type")
        return tree.TypeDecl(name, self.span_from(start), type_)

    def _parse_enum(self) -> tree.TypeExpr:
        start = self.starts[self.take()]
        opener = self.i
        members: list[tree.Name] = []
        try:
            self.expect("{", "after `enum`")
            while True:
                members.append(self.name("the name of a member"))
                if self.kinds[self.i] == "=":
                    raise self.failure(
                        "S005",
                        "expected `,` or `}` after the member, found `=`",
                        notes=("members have no numbers of their own",),
                    )
                if not self.accept_comma("}", "the member", opener):
                    break
        except Panic:
            self.damaged = True
            self.skip_expression(opener)
        return tree.EnumTypeExpr(self.span_from(start), tuple(members))

    def skip_misplaced_declaration(self) -> None:
        """Reports a declaration inside another declaration, parses it, and leaves it out."""
        word = self.texts[self.i]
        computes = self.blocks > 0 or not {"step", "der"}.isdisjoint(self.items)
        local = word in ("const", "param") and computes
        help_ = "write `let` or `var`" if local else "move it out"
        message = f"`{word}` stands only at the top level of a file"
        self.report("S009", message, helps=(help_,), once=False)
        outer = (self.declared, self.damaged, self.items, self.blocks, self.depth, self.indent)
        self.inner = True
        self._declaration(_DECLARATIONS["topic" if word == "input" else word])
        self.inner = False
        if self.declared is not None:
            self.broken.add(self.declared.text)
        self.declared, self.damaged, self.items, self.blocks, self.depth, self.indent = outer

    def _parse_const(self) -> tree.Decl:
        start = self.starts[self.take()]
        name = self.declare("the name of the constant")
        type_ = self.typed("the constant")
        data: str | None = None
        data_span: Span | None = None
        value: tree.SyntaxExpr | None = None
        self.assign("after the type of the constant")
        if self.is_word("data") and self.kinds[self.i + 1] == STRING:
            data_span = self.token_span(self.i + 1)
            data = string_value(self.texts[self.i + 1])
            self.i += 2
            self.expect_semicolon("the data file")
        else:
            value = self.value("the value of the constant")
        return tree.ConstDecl(name, self.span_from(start), type_, value, data, data_span)

    def _parse_param(self) -> tree.Decl:
        start = self.starts[self.take()]
        name = self.declare("the name of the parameter")
        type_ = self.typed("the parameter")
        found = clauses(self, "parameter", _OF_A_PARAMETER)
        if "=" not in found:
            self.assign("after the type of the parameter")
        self.expect_semicolon("the parameter")
        span = self.span_from(start)
        return tree.ParamDecl(name, span, type_, found["="], found.get("in"))

    def _parse_topic(self) -> tree.Decl:
        start = self.starts[self.i]
        is_input = self.accept_word("input")
        self.i += 1
        name = self.declare("the name of the topic")
        type_ = self.typed("the topic")
        found = clauses(self, "topic", _OF_A_TOPIC)
        self.expect_semicolon("the topic")
        return tree.TopicDecl(
            name,
            self.span_from(start),
            is_input,
            type_,
            found.get("in"),
            default=found.get("="),
            max_age=found.get("max_age"),
            static="static" in found,
        )

    def _parse_set_of_topic(self) -> tree.ValueSet:
        start = self.i
        try:
            return parse_value_set(self)
        except Panic:
            self.damaged = True
            self.depth = 0
            if self.kinds[start] == "{":
                self.i = start
                self.skip_braces()
            else:
                self.skip_interval(start)
            span = self.span_from(self.starts[start])
            return tree.IntervalExpr(tree.ErrorExpr(span), tree.ErrorExpr(span), span)

    def _parse_extern(self) -> tree.Decl:
        following = self.kinds[self.i + 1]
        if following == "fun":
            return parse_fun(self)
        if following == "node":
            return parse_node(self)
        if following == "plant":
            return parse_plant(self)
        self.i += 1
        if self.kinds[self.i + 1] == NAME and self.kinds[self.i] in (NAME, "topic", "rta"):
            self.broken.add(self.texts[self.i + 1])
        raise self.failure(
            "S005", f"expected `fun`, `node` or `plant` after `extern`, found {self.found()}"
        )


_OF_A_PARAMETER: dict[str, Step] = {
    "=": equal("after the type of the parameter", "the default of the parameter"),
    "in": range_of("the range of the parameter"),
}
_OF_A_TOPIC: dict[str, Step] = {
    "in": Parser._parse_set_of_topic,
    "=": equal("before the default of the topic", "the default of the topic"),
    "max_age": time("`max_age`"),
    "static": lambda _: True,
}
_DECLARATIONS: dict[str, Callable[[Parser], tree.Decl]] = {
    "import": Parser._parse_import,
    "type": Parser._parse_type_declaration,
    "const": Parser._parse_const,
    "param": Parser._parse_param,
    "fun": parse_fun,
    "extern": Parser._parse_extern,
    "topic": Parser._parse_topic,
    "node": parse_node,
    "rta": parse_rta,
    "plant": parse_plant,
    "system": parse_system,
    "test": parse_test,
}
_SHOWN_WORDS = tuple(word for word in _DECLARATIONS if word != "import")
