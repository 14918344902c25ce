"""Parses expressions and intervals.

Purpose: precedence climbing over `expr` of the grammar, operands, intervals.
Non-goals: statements and declarations (`statements.py`, `parser.py`), types and sets of values
(`types.py`); what a name means.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Span
from soter.diagnostics.fixes import replace
from soter.language.syntax import tree
from soter.language.syntax.lexer import ERROR, NAME, UNIT_NS, period_text, printable
from soter.language.syntax.parsing.literals_and_operators import (
    ANY,
    COMPARISON,
    LEVELS_MAX,
    NUMBERS,
    PRECEDENCE,
    add_unit_help,
    fields_helps,
    number_literal,
    operator_meant,
    refuse_depth,
    refuse_expression,
    report_foreign_operator,
    report_nesting,
    tree_height,
)
from soter.language.syntax.parsing.token_cursor import Cursor, Panic

if TYPE_CHECKING:
    from soter.diagnostics.diagnostic import Help

_SHOWN_MAX = 100
"""Most characters of an edit that a message shows."""

_CONVERSIONS = frozenset(["int", "float"])
"""Types that are also called as functions: `float(n)`, `int(x)`."""

_NO_OPERATORS = {
    "++": "write `x = x + 1;` as a statement of its own",
    "**": "there is no power operator: multiply",
}
"""Operator of another language -> what to write in Soter."""


class ExpressionParser(Cursor):
    """The part of the parser that reads expressions."""

    __slots__ = ()

    # ------------------------------------------------------------ entry points

    def expr(self, subject: str, *, stop_at_brace: bool = False) -> tree.SyntaxExpr:
        """Parses an expression that messages call `subject`; gives an ErrorExpr if it is broken."""
        start = self.i
        depth = self.depth
        self.strict = False
        try:
            result = self.expression(ANY)
        except Panic:
            self.depth = depth
            self.skip_expression(start, stop_at_brace=stop_at_brace)
            return tree.ErrorExpr(self.span_from(self.starts[start]))
        if self.i - start > LEVELS_MAX and tree_height(result) > LEVELS_MAX:
            report_nesting(self, result.span, subject)
            return tree.ErrorExpr(result.span)
        return result

    def value(self, subject: str) -> tree.SyntaxExpr:
        """Parses an expression and the `;` after it."""
        return self.up_to_semicolon(self.expr(subject), subject)

    def up_to_semicolon(self, result: tree.SyntaxExpr, subject: str) -> tree.SyntaxExpr:
        """Steps over the `;` after `result`; gives an ErrorExpr if other tokens come before it."""
        if self.accept(";"):
            return result
        self.report_missing_semicolon(subject)
        if self.may_go_on():
            return result
        start = self.i
        add_unit_help(self, start)
        self.skip_expression(start)
        self.accept(";")
        return tree.ErrorExpr(result.span)

    def time(self, subject: str) -> tree.SyntaxExpr:
        """Parses an expression for a time; reports a bare number, which needs a unit."""
        result = self.expr(subject, stop_at_brace=True)
        if isinstance(result, tree.IntLit | tree.FloatLit):
            i = self.i
            number = result.span.text
            unit = self.texts[i] if self.kinds[i] == NAME else ""
            helps: tuple[Help, ...] = ()
            whole = Span(self.source, result.span.start, self.ends[i])
            if unit in UNIT_NS:
                title = f"write `{number}{unit}`, without a space"
                helps = (replace(whole, f"{number}{unit}", title),)
                self.i += 1
            elif unit.lower() == "hz":
                period = period_text(result.value)
                title = f"write the time between two steps: `{period}`"
                helps = (replace(whole, period, title),)
                self.i += 1
            elif self.kinds[i] != ",":
                helps = (replace(result.span, f"{number}ms"), replace(result.span, f"{number}s"))
            self.quiet = -1
            self.report(
                "S019",
                f"{subject} needs a unit of time",
                self.span_from(result.span.start),
                "a number without a unit",
                notes=("units are ns, us, ms, s, min and h, written right behind the number",),
                helps=helps,
                once=False,
            )
            return tree.ErrorExpr(result.span)
        return result

    def time_value(self, subject: str) -> tree.SyntaxExpr:
        """Parses a time and the `;` after it."""
        result = self.time(subject)
        self.expect_semicolon(subject)
        return result

    # ------------------------------------------------------------ operators

    def expression(self, limit: int) -> tree.SyntaxExpr:
        """Parses an expression of operators that bind at least as tightly as `limit`."""
        kinds = self.kinds
        self.depth += 1
        if self.depth > LEVELS_MAX:
            refuse_depth(self, "expression")
        start = self.starts[self.i]
        kind = kinds[self.i]
        left = self._parse_prefixed() if kind in ("-", "!") else self._parse_postfix()
        while True:
            op = kinds[self.i]
            precedence = PRECEDENCE.get(op)
            if precedence is None:
                meant = operator_meant(self, op)
                if meant is None:
                    break
                op, precedence = meant, PRECEDENCE[meant]
                if precedence >= limit:
                    report_foreign_operator(self, op)
            if precedence < limit:
                break
            at = self.i
            self.i = at + 1
            right = self.expression(precedence + 1)
            span = Span(self.source, start, self.ends[self.i - 1])
            left = tree.BinaryExpr(span, op, left, right)
            if precedence == COMPARISON and PRECEDENCE.get(kinds[self.i]) == COMPARISON:
                left = self._refuse_chain(left, at)
        if limit == ANY and kinds[self.i] == "?":
            left = self._parse_conditional(left, start)
        self.depth -= 1
        return left

    def _parse_prefixed(self) -> tree.SyntaxExpr:
        """Parses any number of `-` and `!` and their operand, without recursion."""
        kinds = self.kinds
        signs = [self.i]
        while kinds[self.i + 1] in ("-", "!"):
            self.i += 1
            signs.append(self.i)
        self.i += 1
        self.tight.extend(signs)
        if len(signs) > LEVELS_MAX:
            refuse_depth(self, "expression")
        operand = self._parse_postfix()
        end = self.ends[self.i - 1]
        for sign in reversed(signs):
            span = Span(self.source, self.starts[sign], end)
            operand = tree.UnaryExpr(span, kinds[sign], operand)
        return operand

    def _parse_conditional(self, condition: tree.SyntaxExpr, start: int) -> tree.SyntaxExpr:
        opener = self.take()
        then = self.expression(ANY)
        if self.kinds[self.i] != ":":
            raise self.failure(
                "S005",
                f"expected `:` after the first choice of `? :`, found {self.found()}",
                also=((self.token_span(opener), "the choice begins here"),),
            )
        self.spaced.append(self.take())
        otherwise = self.expression(ANY)
        span = Span(self.source, start, self.ends[self.i - 1])
        return tree.ConditionalExpr(span, condition, then, otherwise)

    def _refuse_chain(self, left: tree.SyntaxExpr, first: int) -> tree.SyntaxExpr:
        """Reports a chain `a < b < c` with one error, and gives an ErrorExpr."""
        second = self.i
        also = ((self.token_span(first), "the first one"),)
        texts = [left.span.text]
        middle = self.source.text[self.ends[first] : self.ends[second - 1]].strip()
        while PRECEDENCE.get(self.kinds[self.i]) == COMPARISON:
            op = self.kinds[self.take()]
            right = self.expression(COMPARISON + 1).span.text
            texts.append(f"{middle} {op} {right}")
            middle = right
        joined = " && ".join(texts)
        whole = self.span_from(left.span.start)
        after, self.i = self.i, second
        self.quiet = -1
        self.report(
            "S017",
            "comparisons do not chain",
            self.token_span(second),
            "a second comparison",
            also=also,
            helps=(replace(whole, joined, None if len(joined) < _SHOWN_MAX else "compare twice"),),
        )
        self.i = after
        return tree.ErrorExpr(self.span_from(left.span.start))

    # ------------------------------------------------------------ operands

    def _parse_postfix(self) -> tree.SyntaxExpr:
        """Parses a primary expression and the fields, indices and calls after it."""
        i = self.i
        kinds = self.kinds
        kind = kinds[i]
        start = self.starts[i]
        result: tree.SyntaxExpr
        if kind == "choose" or (kinds[i + 1] == "choose" and self.is_word("fair")):
            result = self._parse_choose()
        elif kind == NAME or (kind in _CONVERSIONS and kinds[i + 1] == "("):
            if self.texts[i] == "not" and kinds[i + 1] in (NAME, "true", "false", "!"):
                i = self._skip_not()
                start = self.starts[i]
            span = Span(self.source, start, self.ends[i])
            result = tree.NameExpr(span, tree.Name(self.texts[i], span))
            self.i = i + 1
        elif kind == "(":
            result = self._parse_parenthesised()
        else:
            result = self._parse_literal(kind)
        while True:
            kind = kinds[self.i]
            if kind == ".":
                self.i += 1
                field = self.name("the name of a field after `.`")
                span = Span(self.source, start, self.ends[self.i - 1])
                result = tree.FieldExpr(span, result, field)
            elif kind == "[":
                result = self._parse_index(result, start)
            elif kind == "(":
                result = self._call(result, start)
            elif kind in _NO_OPERATORS:
                message = f"`{kind}` is not an operator of Soter"
                raise self.failure("S015", message, helps=(_NO_OPERATORS[kind],))
            else:
                return result

    def _skip_not(self) -> int:
        """Reports `not`, and skips it with the signs after it; gives the index of the operand."""
        token = self.token_span(self.i)
        blank = Span(self.source, token.start, self.starts[self.i + 1])
        self.report(
            "S015", "`not` is not an operator of Soter", helps=(replace(blank, "!", "write `!`"),)
        )
        while self.kinds[self.i] in ("!", "-") or self.is_word("not"):
            self.i += 1
        if self.kinds[self.i] != NAME:
            raise Panic
        return self.i

    def _parse_parenthesised(self) -> tree.SyntaxExpr:
        opener = self.take()
        result = self.expression(ANY)
        if self.kinds[self.i] == ",":
            raise self.failure(
                "S005",
                "expected `)` after the expression, found `,`",
                self.span_from(self.starts[opener]),
                "there are no tuples",
                helps=("write a record, `{ x: a, y: b }`, or an array, `[a, b]`",),
            )
        self.close(")", "the expression", opener)
        return result

    def _parse_index(self, target: tree.SyntaxExpr, start: int) -> tree.SyntaxExpr:
        opener = self.take()
        self.tight.append(opener)
        index = self.expression(ANY)
        if self.kinds[self.i] == ",":
            raise self.failure(
                "S005",
                "expected `]` after the index, found `,`",
                helps=(
                    replace(
                        self.token_span(self.i),
                        "][",
                        "write one pair of brackets per dimension: `a[i][j]`",
                    ),
                ),
            )
        self.close("]", "the index", opener)
        return tree.IndexExpr(Span(self.source, start, self.ends[self.i - 1]), target, index)

    def _call(self, callee: tree.SyntaxExpr, start: int) -> tree.SyntaxExpr:
        opener = self.i
        self.tight.append(opener)
        named = isinstance(callee, tree.NameExpr | tree.FieldExpr)
        if not named:
            self.report(
                "S023",
                "only the name of a function can be called",
                callee.span,
                "this is not a name",
                helps=("a product is written with `*`",),
            )
        self.i += 1
        arguments = self._parse_elements(")", "the argument", opener)
        span = Span(self.source, start, self.ends[self.i - 1])
        return tree.CallExpr(span, callee, arguments) if named else tree.ErrorExpr(span)

    def _parse_elements(self, close: str, subject: str, opener: int) -> tuple[tree.SyntaxExpr, ...]:
        """Parses expressions up to `close`, and steps over it."""
        if self.accept(close):
            return ()
        elements = [self.expression(ANY)]
        while self.accept(","):
            if self.kinds[self.i] == close:
                if close == ")":
                    self.report("S007", "expected an argument after `,`, found `)`", once=False)
                break
            elements.append(self.expression(ANY))
        self.close(close, subject, opener)
        return tuple(elements)

    def close(self, kind: str, after: str, opener: int) -> None:
        """Steps over the bracket `kind` that closes token `opener`; raises Panic without it."""
        if self.accept(kind):
            return
        wanted = f"`{kind}`" if after in ("the expression", "the index") else f"`,` or `{kind}`"
        raise self.failure(
            "S005",
            f"expected {wanted} after {after}, found {self.found()}",
            also=((self.token_span(opener), "opened here"),),
        )

    def _parse_literal(self, kind: str) -> tree.SyntaxExpr:
        """Parses a primary that is neither a name nor in parentheses."""
        i = self.i
        span = Span(self.source, self.starts[i], self.ends[i])
        text = self.texts[i]
        if kind == "{":
            return self._record()
        misused = text in self.misused
        if not misused and kind not in NUMBERS and kind not in ("true", "false", "[", ERROR):
            return refuse_expression(self, kind)
        self.i = i + 1
        if kind in NUMBERS:
            return number_literal(self, span, kind)
        if kind in ("true", "false"):
            return tree.BoolLit(span, kind == "true")
        if kind == "[":
            elements = self._parse_elements("]", "the element", i)
            return tree.ListExpr(self.span_from(span.start), elements)
        if kind == ERROR:
            return tree.ErrorExpr(span)
        return tree.NameExpr(span, tree.Name(text, span))

    def _record(self) -> tree.SyntaxExpr:
        opener = self.i
        start = self.starts[opener]
        self.i += 1
        entries: list[tuple[tree.Name, tree.SyntaxExpr]] = []
        while True:
            if self.kinds[self.i] == "}" and not entries:
                raise self.failure(
                    "S007", "expected a field, found `}`", notes=("a record has fields",)
                )
            if self.kinds[self.i] == "{" and not entries:
                raise self.failure(
                    "S007",
                    "expected `field: value` in a record, found `{`",
                    self.token_span(opener),
                    helps=fields_helps(self, opener),
                )
            if self.kinds[self.i + 1] in (",", "}") and not entries:
                raise self.failure(
                    "S007",
                    f"expected `field: value` in a record, found {self.found()}",
                    helps=fields_helps(self, opener),
                )
            field = self.name("the name of a field")
            if self.kinds[self.i] == "=":
                self.report(
                    "S005",
                    f"expected `:` after the field `{field.text}`, found `=`",
                    helps=(replace(self.token_span(self.i), ":", f"write `{field.text}: ...`"),),
                    skip=1,
                )
            else:
                self.expect(":", f"after the field `{printable(field.text)}`")
            entries.append((field, self.expression(ANY)))
            if not self.accept_comma("}", "the field", opener):
                break
        return tree.RecordExpr(self.span_from(start), tuple(entries))

    def _parse_choose(self) -> tree.SyntaxExpr:
        """Parses `[fair] choose` and its alternatives."""
        start = self.starts[self.i]
        fair = self.accept_word("fair")
        self.i += 1
        opener = self.i
        kind = self.kinds[opener]
        of: tree.TypeExpr | None = None
        interval: tree.IntervalExpr | None = None
        options: tuple[tree.SyntaxExpr, ...] = ()
        if kind == "[":
            strict = self.strict
            interval = self.interval("the choices")
            self.strict = strict
        elif kind == "{":
            self.i += 1
            options = self._parse_elements("}", "the choice", opener)
        elif kind == "bool":
            self.i += 1
            of = tree.BuiltinType(self.token_span(opener), kind)
        elif kind == NAME:
            ref = self.ref("an enum")
            of = tree.NamedType(ref.span, ref)
        else:
            helps = ("write `choose [low, high]`",) if kind == "int" else ()
            raise self.failure(
                "S007",
                f"expected what to choose from, found {self.found()}",
                notes=("that is `bool`, an enum, `[low, high]` or `{ a, b, c }`",),
                helps=helps,
            )
        return tree.ChooseExpr(self.span_from(start), fair, of, interval, options)

    # ------------------------------------------------------------ intervals and sets

    def interval(self, subject: str) -> tree.IntervalExpr:
        """Parses `[low, high]`; raises Panic if the bracket is missing."""
        opener = self.i
        if self.kinds[opener] != "[":
            raise self.failure(
                "S005",
                f"expected {subject} as `[low, high]`, found {self.found()}",
                helps=("an interval is written with brackets, ends included: `[-1.0, 1.0]`",),
            )
        self.i += 1
        self.strict = True
        low = self.expression(ANY)
        if self.kinds[self.i] == "..":
            self.report(
                "S005",
                "expected `,` between the ends of the interval, found `..`",
                helps=(
                    replace(self.token_span(self.i), ",", "an interval is written `[low, high]`"),
                ),
                skip=1,
            )
        else:
            self.expect(",", "between the ends of the interval", opener=opener)
        high = self.expression(ANY)
        self.strict = False
        if self.kinds[self.i] == ")":
            self.report(
                "S005",
                "expected `]` after the interval, found `)`",
                notes=("intervals include both ends",),
                skip=1,
            )
        else:
            self.expect("]", "after the interval", opener=opener)
        return tree.IntervalExpr(low, high, self.span_from(self.starts[opener]))
