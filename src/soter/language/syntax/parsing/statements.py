"""Parses statements and blocks.

Purpose: `block` and `statement` of the grammar. A statement with a mistake keeps the names that
it declares if they can be read, so that later lines are not reported for them.
Non-goals: expressions (`expressions.py`); whether a place may be assigned (`language/check/`).
"""

# ruff: noqa: SLF001 - the tables at the end name the methods of the class before them

from __future__ import annotations

from soter.diagnostics.diagnostic import Span
from soter.diagnostics.fixes import replace
from soter.language.syntax import tree
from soter.language.syntax.lexer import (
    DURATION,
    EOF,
    FLOAT,
    INT,
    NAME,
    RESERVED,
    STRING,
    printable,
    string_value,
)
from soter.language.syntax.parsing.expressions import ExpressionParser
from soter.language.syntax.parsing.literals_and_operators import refuse_c_loop, report_unclosed
from soter.language.syntax.parsing.token_cursor import (
    BODY_WORDS,
    ITEM_WORDS,
    STATEMENT_WORDS,
    Panic,
)
from soter.language.syntax.parsing.types import type_expression
from soter.language.syntax.their_words import THEIRS

#: Statement blocks may nest so deep.
BLOCKS_MAX = 64

_ELSEIF = frozenset(["elif", "elsif", "else_if"])
_VALUES = frozenset([INT, FLOAT, DURATION, "true", "false", "(", "-"])
#: What may follow the name of a variable that is assigned.
PLACE_FOLLOWS = frozenset(["=", ".", "[", ":="])


class StatementParser(ExpressionParser):
    """The part of the parser that reads statements."""

    __slots__ = ()

    def block(self, where: str, *, single: bool = False) -> tree.Block:
        """Parses `{ statements }`; without `{` one statement if `single`, else all up to `}`."""
        start = self.starts[self.i]
        opener = self.i
        if self.kinds[opener] == "{":
            self.opened.append(opener)
            self.i += 1
        elif single:
            return self._parse_without_brace(where, start)
        else:
            self._report_missing_brace(where)
        self.blocks += 1
        if self.blocks > BLOCKS_MAX:
            self.report(
                "S020",
                "blocks are nested too deeply",
                self.token_span(opener),
                notes=(f"at most {BLOCKS_MAX} levels",),
                helps=("move the inner blocks into functions",),
            )
            self.i = opener
            self.skip_braces()
            self.damaged = True
            self.blocks -= 1
            return tree.Block((), self.span_from(start))
        statements: list[tree.SyntaxStmt] = []
        kinds = self.kinds
        while True:
            if self.accept("}"):
                break
            kind = kinds[self.i]
            if kind == EOF or (kind not in STATEMENT_WORDS and self.is_at_declaration()):
                if kind != EOF and self.is_nested_declaration():
                    self.skip_misplaced_declaration()
                    continue
                report_unclosed(self, opener, "this block")
                break
            item = kind in ITEM_WORDS and kind in self.items and kinds[self.i + 1] in (NAME, "{")
            if item and not self.are_braces_closed(self.blocks + 1):
                report_unclosed(self, opener, "this block")  # the body around goes on here
                break
            self._parse_or_recover(statements, kind)
        self.blocks -= 1
        return tree.Block(tuple(statements), self.span_from(start))

    def _parse_or_recover(self, statements: list[tree.SyntaxStmt], kind: str) -> None:
        """Parses one statement and adds it to the list, or skips tokens that begin no statement."""
        before = self.i
        blocks = self.blocks
        try:
            parse = _STATEMENTS.get(kind)
            if parse is None and kind in RESERVED and self.kinds[before + 1] in PLACE_FOLLOWS:
                parse = StatementParser._parse_assign  # a reserved word taken for a variable
            if parse is not None:
                statements.append(parse(self))
            else:
                self._report_no_statement(kind)
        except Panic:
            self.depth = 0
            self.blocks = blocks
            self.damaged = True
            if self.i == before:
                self.advance()
            self.skip_statement()

    def skip_misplaced_declaration(self) -> None:
        """Reports a declaration inside another declaration, and steps over it."""
        raise NotImplementedError

    def _report_missing_brace(self, where: str) -> None:
        message = f"expected `{{` {where}, found {self.found()}"
        if not self._is_at_statement():
            raise self.failure("S005", message)
        self.report("S005", message, helps=("braces are never left out",), once=False)

    def _parse_without_brace(self, where: str, start: int) -> tree.Block:
        self._report_missing_brace(where)
        statements: list[tree.SyntaxStmt] = []
        self.blocks += 1
        if self.blocks > BLOCKS_MAX:
            raise Panic
        self._parse_or_recover(statements, self.kinds[self.i])
        self.blocks -= 1
        return tree.Block(tuple(statements), self.span_from(start))

    def _is_at_statement(self) -> bool:
        kind = self.kinds[self.i]
        if kind == NAME:
            return self.kinds[self.i + 1] in PLACE_FOLLOWS
        return kind in STATEMENT_WORDS

    def head(self, subject: str) -> tree.SyntaxExpr:
        """Parses the expression before a statement's block; raises Panic if no block follows."""
        start = self.i
        if self.kinds[start] == "{" and self.kinds[start + 2] != ":":
            self.report("S007", f"expected {subject}, found `{{`", once=False)
            return tree.ErrorExpr(self.after_previous())
        result = self.expr(subject, stop_at_brace=True)
        if self.kinds[self.i] in ("{", "..") or self._is_at_statement():
            return result
        message = f"expected `{{` after {subject}, found {self.found()}"
        indented = self.kinds[self.i] == ":" and self.kinds[self.i + 1] != "{"
        braces = ("a block stands in braces: `if x > 0.0 { ... }`",)
        self.report("S005", message, helps=braces if indented else ())
        self.skip_expression(start, stop_at_brace=True)
        if self.kinds[self.i] != "{":
            raise Panic
        return tree.ErrorExpr(result.span)

    # ------------------------------------------------------------ one method per statement

    def let(self) -> tree.SyntaxStmt:
        """Parses `let name = value;`."""
        start = self.starts[self.take()]
        if self.is_word("mut"):
            both = self.token_span(self.i - 1).to(self.token_span(self.i))
            helps = (replace(both, "var", "write `var` for `let mut`"),)
            self.report("S015", "`mut` is no word of Soter", helps=helps, skip=1)
        name = self.name("a name after `let`")
        type_ = type_expression(self, "a type after `:`") if self.accept(":") else None
        value = self.assigned_value(f"`{printable(name.text)}`", "the value")
        return tree.LetStmt(self.span_from(start), name, type_, value)

    def _parse_var(self) -> tree.SyntaxStmt:
        start = self.starts[self.take()]
        name = self.name("a name after `var`")
        type_ = type_expression(self, "a type after `:`") if self.accept(":") else None
        if type_ is not None and self.kinds[self.i] not in ("=", ":=", "=="):
            self.require_no_initial("the type of the variable")
            return tree.VarStmt(self.span_from(start), name, type_, None)
        value = self.assigned_value(f"`{printable(name.text)}`", "the value")
        return tree.VarStmt(self.span_from(start), name, type_, value)

    def require_no_initial(self, after: str) -> None:
        """Steps over the `;` after a type; reports a value that was written without `=`."""
        if self.kinds[self.i] in _VALUES:
            message = f"expected `=` or `;` after {after}, found {self.found()}"
            self.report("S005", message, self.after_previous(), "`=` is missing here")
            self.damaged = True
            self.skip_statement()
        else:
            self.expect_semicolon(after)

    def assigned_value(self, after: str, subject: str) -> tree.SyntaxExpr:
        """Parses `= value;`; gives an ErrorExpr if `=` is missing after `after`."""
        start = self.i
        try:
            self.assign(f"after {after}")
        except Panic:
            self.skip_expression(start)
            self.accept(";")
            return tree.ErrorExpr(self.after_previous())
        return self.value(subject)

    def _parse_assign(self) -> tree.SyntaxStmt:
        start = self.starts[self.i]
        slip = self._parse_misspelt()
        if slip is not None:
            return slip
        place = self._parse_place()
        kind = self.kinds[self.i]
        if kind in ("+=", "-=", "*=", "/=", "%=", "**="):
            end = self.ends[self.item_end() - 1]
            operand = self.source.text[self.ends[self.i] : end].strip()
            operand = operand if operand.isalnum() else f"({operand})"
            whole, text = Span(self.source, start, end), place.span.text
            fix = replace(whole, f"{text} = {text} {kind[:-1]} {operand}")
            helps = (fix,) if operand != "()" else ()
            self.report("S015", f"`{kind}` is not an operator of Soter", helps=helps, skip=1)
        elif kind == "++" or (kind == "-" and self.kinds[self.i + 1] == "-"):
            text = printable(place.span.text)
            raise self.failure(
                "S015",
                f"`{kind}` is not a statement of Soter",
                helps=(f"write `{text} = {text} {kind[0]} 1;`",),
            )
        elif kind == "(":
            raise self.failure(
                "S011", "a call is not a statement", place.span, "functions only compute a value"
            )
        elif kind in (";", "}"):
            raise self.failure("S011", "an expression is not a statement", place.span)
        else:
            self.assign(f"after `{printable(place.span.text)}`")
        value = self.value("the assignment")
        return tree.AssignStmt(self.span_from(start), place, value)

    def _parse_misspelt(self) -> tree.SyntaxStmt | None:
        """Parses a statement with a misspelt word, or one of another language; else None."""
        i = self.i
        word, following = self.texts[i], self.kinds[i + 1]
        if following in PLACE_FOLLOWS:
            return None
        if word in THEIRS:
            raise self.failure("S011", f"expected a statement, found `{printable(word)}`")
        if word in _ELSEIF:
            raise self.failure("S015", f"`{word}` is no word of Soter", helps=("write `elseif`",))
        if following in (NAME, INT) or following in RESERVED:
            near = self.word_close_to(word, STATEMENT_WORDS)
            if near in _STATEMENTS and near != "while":
                message = f"expected a statement, found `{printable(word)}`"
                helps = (replace(self.token_span(i), near, f"did you mean `{near}`?"),)
                self.report("S011", message, helps=helps, once=False)
                return _STATEMENTS[near](self)
        if following == NAME and self.kinds[i + 2] in ("=", ";"):
            message = f"expected a statement, found `{printable(word)}`"
            note = "a variable is declared by `var`, its type stands behind: `var x: float`"
            self.report("S011", message, notes=(note,))
            return self._parse_c_style_declaration()
        return None

    def _parse_c_style_declaration(self) -> tree.SyntaxStmt:
        """Reads the rest of `float x = 3;`, which was reported, as a declaration of `x`."""
        start = self.starts[self.take()]
        name = self.name("a name")
        self.quiet = -1
        value = (
            tree.ErrorExpr(self.after_previous())
            if self.accept(";")
            else self.assigned_value(f"`{printable(name.text)}`", "the value")
        )
        return tree.VarStmt(self.span_from(start), name, None, value)

    def _parse_typed_declaration(self) -> tree.SyntaxStmt:
        word = self.texts[self.i]
        message = f"expected a statement, found the keyword `{word}`"
        if self.kinds[self.i + 1] == NAME:
            name = printable(self.texts[self.i + 1])
            self.report("S011", message, helps=(f"write `var {name}: {word} = ...;`",))
            return self._parse_c_style_declaration()
        raise self.failure("S011", message)

    def _parse_place(self) -> tree.SyntaxExpr:
        start = self.starts[self.i]
        name = self.name("the name of a variable")
        place: tree.SyntaxExpr = tree.NameExpr(name.span, name)
        while True:
            if self.accept("."):
                field = self.name("the name of a field after `.`")
                place = tree.FieldExpr(self.span_from(start), place, field)
            elif self.kinds[self.i] == "[":
                place = self._parse_index(place, start)
            else:
                return place

    def _parse_push(self) -> tree.SyntaxStmt:
        start = self.starts[self.take()]
        place = self._parse_place()
        self.expect(",", "after the list of `push`")
        value = self.value("the pushed value")
        return tree.PushStmt(self.span_from(start), place, value)

    def _parse_publish(self) -> tree.SyntaxStmt:
        start = self.starts[self.take()]
        topic = self.ref("the name of a topic after `publish`")
        value = self.assigned_value("the topic of `publish`", "the publish statement")
        return tree.PublishStmt(self.span_from(start), topic, value)

    def _parse_return(self) -> tree.SyntaxStmt:
        start = self.starts[self.take()]
        if self.items and self.accept(";"):  # in a step, where `return` is the mistake
            return tree.ReturnStmt(self.span_from(start), tree.ErrorExpr(self.after_previous()))
        value = self.value("the returned value")
        return tree.ReturnStmt(self.span_from(start), value)

    def _parse_assert(self) -> tree.SyntaxStmt:
        start = self.starts[self.take()]
        condition = self.expr("the condition")
        message = None
        if self.accept(","):
            if self.kinds[self.i] == STRING:
                message = string_value(self.texts[self.take()])
            else:
                self.report("S005", f"expected a string after `,`, found {self.found()}")
        self.expect_semicolon("the assertion")
        return tree.AssertStmt(self.span_from(start), condition, message)

    def _parse_if(self) -> tree.SyntaxStmt:
        start = self.starts[self.take()]
        arms = [self._parse_arm()]
        while self.accept("elseif") or self._accept_else_if():
            arms.append(self._parse_arm())
        otherwise = self.block("after `else`", single=True) if self.accept("else") else None
        return tree.IfStmt(self.span_from(start), tuple(arms), otherwise)

    def _parse_arm(self) -> tuple[tree.SyntaxExpr, tree.Block]:
        condition = self.head("the condition")
        return condition, self.block("after the condition", single=True)

    def _accept_else_if(self) -> bool:
        """Whether `else if`, `elif` or the like is written for `elseif`; if so, reports it."""
        i = self.i
        if self.kinds[i] == "else" and self.kinds[i + 1] == "if":
            span = self.token_span(i).to(self.token_span(i + 1))
            helps = (replace(span, "elseif"),)
            self.report("S015", "`else if` is one word in Soter", span, helps=helps, skip=2)
            return True
        if self.kinds[i] == NAME and self.texts[i] in _ELSEIF:
            helps = (replace(self.token_span(i), "elseif"),)
            self.report("S015", f"`{self.texts[i]}` is no word of Soter", helps=helps, skip=1)
            return True
        return False

    def _parse_for(self) -> tree.SyntaxStmt:
        start = self.starts[self.take()]
        name, low = self.loop_head()
        high = self.head("the end of the range") if self.accept("..") else None
        body = self.block("after the range", single=True)
        if high is None:
            return tree.ForEachStmt(self.span_from(start), name, low, body)
        return tree.ForRangeStmt(self.span_from(start), name, low, high, body)

    def loop_head(self) -> tuple[tree.Name, tree.SyntaxExpr]:
        """Parses `name in low` after the word `for`."""
        if self.kinds[self.i] == "(":
            refuse_c_loop(self)
        name = self.name("the name of the loop variable after `for`")
        if self.kinds[self.i] in ("=", ":", ":="):
            self.report(
                "S005",
                f"expected `in` after the loop variable, found {self.found()}",
                helps=(f"write `for {printable(name.text)} in 0..10 {{ ... }}`",),
                skip=1,
            )
        else:
            self.expect_word("in", "after the loop variable")
        return name, self.head("the range")

    def _parse_while(self) -> tree.SyntaxStmt:
        start = self.starts[self.i]
        self.report(
            "S018",
            "there is no `while`: a loop must have a constant bound",
            label="may run forever",
            notes=("the cost of every step is bounded and known before it runs",),
            helps=("write `for i in 0..N { if condition { ... } }`",),
            skip=1,
        )
        return tree.IfStmt(self.span_from(start), (self._parse_arm(),), None)

    def _parse_dangling_else(self) -> tree.SyntaxStmt:
        word = self.texts[self.i]
        self.report("S011", f"`{word}` without an `if` before it", skip=1)
        if self.kinds[self.i] == "if" or word == "elseif":
            self.accept("if")
            start = self.starts[self.i]
            return tree.IfStmt(self.span_from(start), (self._parse_arm(),), None)
        body = self.block("after `else`", single=True)
        condition = tree.ErrorExpr(body.span)
        return tree.IfStmt(body.span, ((condition, body),), None)

    def _report_no_statement(self, kind: str) -> None:
        """Reports that the token at the cursor begins no statement."""
        if kind == ";":
            self.skip_stray_semicolons()
            return
        message = f"expected a statement, found {self.found()}"
        of_a_body = kind in BODY_WORDS and not self.are_braces_closed(self.blocks + 1)
        note = f"`{kind}` belongs in the body around: is a `}}` missing before it?"
        raise self.failure("S011", message, notes=(note,) if of_a_body else ())

    def skip_stray_semicolons(self) -> None:
        """Reports a `;` that ends nothing, and skips it with all `;` that follow."""
        behind_block = self.i and self.kinds[self.i - 1] == "}"
        message = "no `;` after a block" if behind_block else "this `;` ends nothing"
        self.report("S014", message, helps=("leave it out",))
        while self.kinds[self.i] == ";":
            self.i += 1


_STATEMENTS = {
    NAME: StatementParser._parse_assign,
    "let": StatementParser.let,
    "var": StatementParser._parse_var,
    "push": StatementParser._parse_push,
    "publish": StatementParser._parse_publish,
    "return": StatementParser._parse_return,
    "assert": StatementParser._parse_assert,
    "if": StatementParser._parse_if,
    "for": StatementParser._parse_for,
    "while": StatementParser._parse_while,
    "else": StatementParser._parse_dangling_else,
    "elseif": StatementParser._parse_dangling_else,
    "float": StatementParser._parse_typed_declaration,
    "int": StatementParser._parse_typed_declaration,
    "bool": StatementParser._parse_typed_declaration,
    "duration": StatementParser._parse_typed_declaration,
}
