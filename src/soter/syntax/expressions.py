"""Expressions, types and value sets: tokens to tree.

Purpose: precedence climbing over `expr` of the grammar, with hints for the slips people bring
from other languages; types, intervals and value sets.
Non-goals: statements and declarations (`statements.py`, `parser.py`); what a name means.

Nesting is bounded (`LEVELS_MAX`), so neither this parser nor any recursive pass after it can
run out of stack on hostile input.
"""

from __future__ import annotations

import math
from dataclasses import fields
from fractions import Fraction
from typing import TYPE_CHECKING

from soter.diagnostics.span import Span
from soter.syntax import tree
from soter.syntax.cursor import Cursor, Panic
from soter.syntax.tokens import (
    DURATION,
    EOF,
    ERROR,
    FLOAT,
    INT,
    NAME,
    RESERVED,
    STRING,
    UNIT_NS,
    visible,
)

if TYPE_CHECKING:
    from typing import NoReturn

#: Levels an expression or a type may nest: brackets and operators count one each.
LEVELS_MAX = 200

_INT_DIGITS_MAX = 40
_DURATION_NS_MAX = 2**63 - 1

_COMPARISON = 3
_PRECEDENCE = {
    "||": 1,
    "&&": 2,
    "<": _COMPARISON,
    "<=": _COMPARISON,
    ">": _COMPARISON,
    ">=": _COMPARISON,
    "==": _COMPARISON,
    "!=": _COMPARISON,
    "+": 4,
    "-": 4,
    "*": 5,
    "/": 5,
    "%": 5,
}
_ANY = 0

#: What stands for which operator in other languages; only between two operands.
_SLIPS = {
    "=": "==",
    "===": "==",
    "!==": "!=",
    "<>": "!=",
    ":=": "==",
    "and": "&&",
    "or": "||",
    "AND": "&&",
    "OR": "||",
    "mod": "%",
}
_OPERAND_WORDS = frozenset([NAME, INT, FLOAT, DURATION, "(", "true", "false", "!", "-"])

_CONVERSIONS = frozenset(["int", "float"])
"""Types that are also called as functions: `float(n)`, `int(x)`."""
_BUILTIN = frozenset(["bool", "float", "duration"])
_TYPE_MEANT = {
    "double": "float",
    "real": "float",
    "float64": "float",
    "float32": "float",
    "f64": "float",
    "f32": "float",
    "number": "float",
    "boolean": "bool",
    "Bool": "bool",
    "integer": "int",
    "int32": "int",
    "int64": "int",
    "uint8": "int",
    "i32": "int",
    "i64": "int",
    "time": "duration",
}


class ExpressionParser(Cursor):
    """The part of the parser that reads expressions and types."""

    __slots__ = ()

    # ------------------------------------------------------------ entry points

    def expr(self, what: str, *, stop_at_brace: bool = False) -> tree.Expr:
        """One expression; `what` names it in messages. A broken one becomes an ErrorExpr."""
        start = self.i
        depth = self.depth
        self.strict = False
        try:
            result = self.expression(_ANY)
        except Panic:
            self.depth = depth
            self.skip_expression(start, stop_at_brace=stop_at_brace)
            return tree.ErrorExpr(self.span_from(self.starts[start]))
        if self.i - start > LEVELS_MAX and height(result) > LEVELS_MAX:
            self._report_nesting(result.span, what)
            return tree.ErrorExpr(result.span)
        return result

    def value(self, what: str) -> tree.Expr:
        """One expression and the `;` behind it."""
        return self.ended(self.expr(what), what)

    def ended(self, result: tree.Expr, what: str) -> tree.Expr:
        """An expression that was read, once its `;` is; an ErrorExpr where more stands between."""
        if self.kinds[self.i] == ";":
            self.i += 1
            return result
        self.missing_semicolon(what)
        if self.fresh_start():
            return result
        start = self.i
        self._explain_unit(start)
        self.skip_expression(start)
        self.accept(";")
        return tree.ErrorExpr(result.span)

    def time(self, what: str) -> tree.Expr:
        """One expression that stands for a time: a bare number is told to get a unit."""
        result = self.expr(what, stop_at_brace=True)
        if isinstance(result, tree.IntLit | tree.FloatLit):
            i = self.i
            number = result.span.text
            unit = self.texts[i] if self.kinds[i] == NAME else ""
            if unit in UNIT_NS:
                help_ = f"write `{number}{unit}`, without a space"
                self.i += 1
            elif unit.lower() == "hz":
                help_ = f"write the time between two steps: `{_period_of(result)}`"
                self.i += 1
            else:
                help_ = f"write `{number}ms` or `{number}s`"
            self.quiet = -1
            self.report(
                "S019",
                f"{what} needs a unit of time",
                self.span_from(result.span.start),
                "a number without a unit",
                notes=("units are ns, us, ms, s, min and h, written right behind the number",),
                helps=(help_,),
            )
            self.quiet = -1
            return tree.ErrorExpr(result.span)
        return result

    def time_value(self, what: str) -> tree.Expr:
        """A time and the `;` behind it."""
        result = self.time(what)
        self.semicolon(what)
        return result

    def _explain_unit(self, i: int) -> None:
        """`10 ms`: extend the error just reported by a help."""
        if self.kinds[i] == NAME and self.texts[i] in UNIT_NS and i and self.problems:
            last = self.problems[-1]
            here = last.primary is not None and last.primary.span.start == self.ends[i - 1]
            if here and last.code == "S004" and self.kinds[i - 1] in (INT, FLOAT):
                text = f"write `{self.texts[i - 1]}{self.texts[i]}`, without a space"
                self.problems[-1] = type(last)(
                    last.code, last.message, last.primary, last.secondary, last.notes, (text,)
                )

    # ------------------------------------------------------------ operators

    def expression(self, limit: int) -> tree.Expr:
        """An expression of operators that bind at least as tightly as `limit`."""
        kinds = self.kinds
        self.depth += 1
        if self.depth > LEVELS_MAX:
            self._too_deep("expression")
        start = self.starts[self.i]
        kind = kinds[self.i]
        left = self._prefixed() if kind in ("-", "!") else self._postfix()
        while True:
            op = kinds[self.i]
            precedence = _PRECEDENCE.get(op)
            if precedence is None:
                slip = self._slip(op)
                if slip is None:
                    break
                op, precedence = slip, _PRECEDENCE[slip]
                if precedence >= limit:
                    self._report_slip(op)
            if precedence < limit:
                break
            at = self.i
            self.i = at + 1
            right = self.expression(precedence + 1)
            span = Span(self.source, start, self.ends[self.i - 1])
            left = tree.BinaryExpr(span, op, left, right)
            if precedence == _COMPARISON and _PRECEDENCE.get(kinds[self.i]) == _COMPARISON:
                left = self._chained(left, at)
        if limit == _ANY and kinds[self.i] == "?":
            left = self._conditional(left, start)
        self.depth -= 1
        return left

    def _prefixed(self) -> tree.Expr:
        """`-` and `!` before an operand, any number of them, without recursion."""
        kinds = self.kinds
        signs = [self.i]
        while kinds[self.i + 1] in ("-", "!"):
            self.i += 1
            signs.append(self.i)
        self.i += 1
        self.tight.extend(signs)
        if len(signs) > LEVELS_MAX:
            self._too_deep("expression")
        operand = self._postfix()
        end = self.ends[self.i - 1]
        for sign in reversed(signs):
            span = Span(self.source, self.starts[sign], end)
            operand = tree.UnaryExpr(span, kinds[sign], operand)
        return operand

    def _conditional(self, condition: tree.Expr, start: int) -> tree.Expr:
        opener = self.i
        self.i += 1
        then = self.expression(_ANY)
        if self.kinds[self.i] != ":":
            raise self.failure(
                "S005",
                f"expected `:` after the first choice of `? :`, found {self.found()}",
                also=((self.token_span(opener), "the choice begins here"),),
            )
        self.spaced.append(self.i)
        self.i += 1
        otherwise = self.expression(_ANY)
        span = Span(self.source, start, self.ends[self.i - 1])
        return tree.ConditionalExpr(span, condition, then, otherwise)

    def _chained(self, left: tree.Expr, first: int) -> tree.Expr:
        """`a < b < c`: reported once for the whole chain."""
        second = self.i
        self.quiet = -1
        self.report(
            "S017",
            "comparisons do not chain",
            self.token_span(second),
            "a second comparison",
            also=((self.token_span(first), "the first one"),),
            helps=("write `a < b && b < c`",),
        )
        while _PRECEDENCE.get(self.kinds[self.i]) == _COMPARISON:
            self.i += 1
            self.expression(_COMPARISON + 1)
        return tree.ErrorExpr(self.span_from(left.span.start))

    def _slip(self, kind: str) -> str | None:
        """The operator meant by a token of another language after an operand."""
        if kind == NAME:
            word = self.texts[self.i]
            if word in _SLIPS and self.kinds[self.i + 1] in _OPERAND_WORDS:
                return _SLIPS[word]
            return None
        return None if self.strict and kind == "=" else _SLIPS.get(kind)

    def _report_slip(self, meant: str) -> None:
        text = self.texts[self.i]
        if text == "=":
            self.report(
                "S016",
                "`=` assigns, it does not compare",
                helps=("comparison for equality is `==`",),
            )
        else:
            self.report(
                "S015", f"`{text}` is not an operator of Soter", helps=(f"write `{meant}`",)
            )

    # ------------------------------------------------------------ operands

    def _postfix(self) -> tree.Expr:
        """A primary and its fields, indices and calls."""
        i = self.i
        kinds = self.kinds
        kind = kinds[i]
        start = self.starts[i]
        result: tree.Expr
        if kind == "choose" or (kinds[i + 1] == "choose" and self.is_word("fair")):
            result = self._choose()
        elif kind == NAME:
            if self.texts[i] == "not" and kinds[i + 1] in (NAME, "true", "false", "!"):
                i = self._skip_not()
                start = self.starts[i]
            span = Span(self.source, start, self.ends[i])
            result = tree.NameExpr(span, tree.Name(self.texts[i], span))
            self.i = i + 1
        elif kind in _CONVERSIONS and kinds[i + 1] == "(":
            span = Span(self.source, start, self.ends[i])
            result = tree.NameExpr(span, tree.Name(self.texts[i], span))
            self.i = i + 1
        elif kind == "(":
            result = self._parenthesised()
        else:
            result = self._literal(kind)
        while True:
            kind = kinds[self.i]
            if kind == ".":
                self.i += 1
                field = self.name("the name of a field after `.`")
                span = Span(self.source, start, self.ends[self.i - 1])
                result = tree.FieldExpr(span, result, field)
            elif kind == "[":
                result = self._index(result, start)
            elif kind == "(":
                result = self._call(result, start)
            elif kind == "++":
                raise self.failure(
                    "S015",
                    "`++` is not an operator of Soter",
                    helps=("write `x = x + 1;` as a statement of its own",),
                )
            elif kind == "**":
                raise self.failure(
                    "S015",
                    "`**` is not an operator of Soter",
                    helps=("there is no power operator: multiply",),
                )
            else:
                return result

    def _skip_not(self) -> int:
        """Report `not`, step over it and over signs behind it, up to a name."""
        self.report("S015", "`not` is not an operator of Soter", helps=("write `!`",))
        while self.kinds[self.i] in ("!", "-") or self.is_word("not"):
            self.i += 1
        if self.kinds[self.i] != NAME:
            raise Panic
        return self.i

    def _parenthesised(self) -> tree.Expr:
        opener = self.i
        self.i += 1
        result = self.expression(_ANY)
        self._close(")", "the expression", opener)
        return result

    def _index(self, target: tree.Expr, start: int) -> tree.Expr:
        opener = self.i
        self.tight.append(opener)
        self.i += 1
        index = self.expression(_ANY)
        if self.kinds[self.i] == ",":
            raise self.failure(
                "S005",
                "expected `]` after the index, found `,`",
                helps=("write one pair of brackets per dimension: `a[i][j]`",),
            )
        self._close("]", "the index", opener)
        return tree.IndexExpr(Span(self.source, start, self.ends[self.i - 1]), target, index)

    def _call(self, callee: tree.Expr, start: int) -> tree.Expr:
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
        arguments = self._elements(")", "the argument", opener)
        span = Span(self.source, start, self.ends[self.i - 1])
        return tree.CallExpr(span, callee, arguments) if named else tree.ErrorExpr(span)

    def _elements(self, close: str, what: str, opener: int) -> tuple[tree.Expr, ...]:
        """Expressions up to `close`, which is stepped over."""
        if self.accept(close):
            return ()
        elements = [self.expression(_ANY)]
        while self.kinds[self.i] == ",":
            self.i += 1
            if self.kinds[self.i] == close:
                if close == ")":
                    self.report("S007", "expected an argument after `,`, found `)`")
                    self.quiet = -1
                break
            elements.append(self.expression(_ANY))
        self._close(close, what, opener)
        return tuple(elements)

    def _close(self, kind: str, after: str, opener: int) -> None:
        if self.kinds[self.i] == kind:
            self.i += 1
            return
        wanted = f"`{kind}`" if after in ("the expression", "the index") else f"`,` or `{kind}`"
        raise self.failure(
            "S005",
            f"expected {wanted} after {after}, found {self.found()}",
            also=((self.token_span(opener), "opened here"),),
        )

    def _literal(self, kind: str) -> tree.Expr:
        """A primary that is neither a name nor parenthesised."""
        i = self.i
        span = Span(self.source, self.starts[i], self.ends[i])
        text = self.texts[i]
        if kind == FLOAT:
            self.i = i + 1
            value = float(text)
            if math.isinf(value):
                return self._too_large(span, "a float")
            return tree.FloatLit(span, value, text)
        if kind == INT:
            self.i = i + 1
            if len(text) > _INT_DIGITS_MAX:
                return self._too_large(span, "an int")
            return tree.IntLit(span, int(text))
        if kind == DURATION:
            self.i = i + 1
            return self._duration(span, text)
        if kind in ("true", "false"):
            self.i = i + 1
            return tree.BoolLit(span, kind == "true")
        if kind == "[":
            self.i = i + 1
            elements = self._elements("]", "the element", i)
            return tree.ListExpr(self.span_from(span.start), elements)
        if kind == "{":
            return self._record()
        if kind == ERROR:
            self.i = i + 1
            return tree.ErrorExpr(span)
        if text in self.misused:
            self.i = i + 1
            return tree.NameExpr(span, tree.Name(text, span))
        return self._no_expression(kind)

    def _duration(self, span: Span, text: str) -> tree.Expr:
        number = text.rstrip("nusmih")
        unit = UNIT_NS[text[len(number) :]]
        approximate = float(number) * unit
        if not approximate <= _DURATION_NS_MAX:
            return self._too_large(span, "a duration (about 292 years at most)")
        if 0 < approximate < 1e-3 or (approximate == 0 and "e" in number.lower()):
            return tree.DurationLit(span, None, text)  # far below a nanosecond
        exact = Fraction(number.replace("_", "")) * unit
        value = exact.numerator if exact.denominator == 1 else None
        return tree.DurationLit(span, value, text)

    def _too_large(self, span: Span, what: str) -> tree.Expr:
        self.i -= 1
        self.report("L005", f"this number is too large for {what}", span)
        self.i += 1
        return tree.ErrorExpr(span)

    def _record(self) -> tree.Expr:
        opener = self.i
        start = self.starts[opener]
        self.i += 1
        entries: list[tuple[tree.Name, tree.Expr]] = []
        while True:
            if self.kinds[self.i] == "}" and not entries:
                raise self.failure(
                    "S007", "expected a field, found `}`", notes=("a record has fields",)
                )
            if self.kinds[self.i + 1] in (",", "}") and not entries:
                raise self.failure(
                    "S007",
                    f"expected `field: value` in a record, found {self.found()}",
                    helps=("arrays and lists are written `[a, b]`",),
                )
            field = self.name("the name of a field")
            if self.kinds[self.i] == "=":
                self.report(
                    "S005",
                    f"expected `:` after the field `{field.text}`, found `=`",
                    helps=(f"write `{field.text}: ...`",),
                )
                self.i += 1
            else:
                self.expect(":", f"after the field `{visible(field.text)}`")
            entries.append((field, self.expression(_ANY)))
            if not self.comma("}", "the field", opener):
                break
        return tree.RecordExpr(self.span_from(start), tuple(entries))

    def _choose(self) -> tree.Expr:
        """`[fair] choose` and what is chosen from."""
        start = self.starts[self.i]
        fair = self.accept_word("fair")
        self.i += 1
        opener = self.i
        kind = self.kinds[opener]
        of: tree.TypeExpr | None = None
        interval: tree.Interval | None = None
        options: tuple[tree.Expr, ...] = ()
        if kind == "[":
            strict = self.strict
            interval = self.interval("the choices")
            self.strict = strict
        elif kind == "{":
            self.i += 1
            options = self._elements("}", "the choice", opener)
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

    def _no_expression(self, kind: str) -> NoReturn:
        """Nothing here begins an expression: say why, as well as the token lets us."""
        message = f"expected an expression, found {self.found()}"
        helps: tuple[str, ...] = ()
        notes: tuple[str, ...] = ()
        if kind == "+":
            helps = ("there is no unary `+`: leave it out",)
        elif kind == "if":
            self.report(
                "S007", message, helps=("a choice inside an expression is `condition ? a : b`",)
            )
            self._skip_choice()
            raise Panic
        elif kind == STRING:
            notes = ("strings stand only after `import`, `from`, `data` and in `assert`",)
        elif kind in ("float", "int", "bool"):
            notes = (f"`{kind}` is a type",)
        elif kind in RESERVED:
            notes = (f"`{kind}` is reserved and cannot be a name",)
        elif kind == "=":
            helps = ("comparison for equality is `==`",)
        raise self.failure("S007", message, notes=notes, helps=helps)

    def _skip_choice(self) -> None:
        """Past an `if ... { } else { }` that stands where an expression should."""
        while self.kinds[self.i] in ("if", "else", "elseif"):
            while self.kinds[self.i] not in ("{", "}", ";", EOF):
                self.i += 1
            if self.kinds[self.i] == "{":
                self.skip_braces()

    def _too_deep(self, what: str) -> NoReturn:
        raise self.failure(
            "S020",
            f"this {what} is nested too deeply",
            notes=(f"at most {LEVELS_MAX} levels: brackets and operators count one each",),
            helps=("name parts of it with `let`",),
        )

    def _report_nesting(self, span: Span, what: str) -> None:
        self.quiet = -1
        self.report(
            "S020",
            f"{what} is nested too deeply",
            Span(span.source, span.start, min(span.end, span.start + 40)),
            "this expression",
            notes=(f"at most {LEVELS_MAX} levels: a chain of n operators has n of them",),
            helps=("name parts of it with `let`, or use a loop",),
        )
        self.quiet = -1

    # ------------------------------------------------------------ types

    def type(self, what: str) -> tree.TypeExpr:
        """A type expression; a broken one becomes an ErrorTypeExpr."""
        start, depth = self.i, self.depth
        try:
            return self._type(what)
        except Panic:
            self.depth = depth
            self._skip_type(start)
            return tree.ErrorTypeExpr(self.span_from(self.starts[start]))

    def _skip_type(self, start: int) -> None:
        kinds = self.kinds
        level = sum(1 if k in "{[(" else -1 for k in kinds[start : self.i] if k in "{}[]()")
        while True:
            kind = kinds[self.i]
            if kind in (";", EOF, "=") or self.at_declaration():
                break
            if level <= 0 and kind in (",", ")", "}", "{", "in", "]"):
                break
            if kind in ("{", "[", "("):
                level += 1
            elif kind in ("}", "]", ")"):
                level -= 1
            self.i += 1
        self.quiet = self.i

    def _type(self, what: str) -> tree.TypeExpr:
        self.depth += 1
        if self.depth > LEVELS_MAX:
            self._too_deep("type")
        start = self.starts[self.i]
        result = self._base_type(what)
        suffixes = 0
        while self.kinds[self.i] == "[":
            opener = self.i
            self.tight.append(opener)
            self.i += 1
            suffixes += 1
            if suffixes > LEVELS_MAX:
                self._too_deep("type")
            bounded = self.accept("<=")
            self.strict = True
            size = self.expression(_ANY)
            self.strict = False
            self._close("]", "the size", opener)
            span = self.span_from(start)
            if bounded:
                result = tree.ListTypeExpr(span, result, size)
            else:
                result = tree.ArrayTypeExpr(span, result, size)
        self.depth -= 1
        return result

    def _base_type(self, what: str) -> tree.TypeExpr:
        i = self.i
        kind = self.kinds[i]
        if kind in _BUILTIN:
            self.i = i + 1
            return tree.BuiltinType(self.token_span(i), kind)
        if kind == "int":
            self.i = i + 1
            if self.kinds[self.i] == "in" and self.kinds[self.i + 1] != "{":
                self.i += 1
                interval = self.interval("the range of an int")
                return tree.RangedIntType(self.span_from(self.starts[i]), interval)
            return tree.BuiltinType(self.token_span(i), "int")
        if kind == "{":
            return self._record_type()
        if kind == NAME:
            ref = self.ref("a type")
            self._foreign_type(ref, i)
            return tree.NamedType(ref.span, ref)
        helps: tuple[str, ...] = ()
        if kind == "enum":
            helps = ("declare it first: `type Name = enum { ... };`",)
        elif kind == "[":
            helps = ("the size of an array follows its type: `float[3]`",)
        raise self.failure("S008", f"expected {what}, found {self.found()}", helps=helps)

    def _foreign_type(self, ref: tree.Ref, i: int) -> None:
        """`List<float>` and the like are no types; `double` is left to the checker."""
        if self.kinds[self.i] != "<":
            return
        self.i = i
        raise self.failure(
            "S008",
            f"`{visible(ref.text)}<...>` is not a type",
            helps=("an array is `float[8]`, a list of at most eight is `float[<=8]`",),
        )

    def _record_type(self) -> tree.TypeExpr:
        opener = self.i
        self.i += 1
        entries: list[tuple[tree.Name, tree.TypeExpr]] = []
        while True:
            if self.kinds[self.i] == "}" and not entries:
                raise self.failure(
                    "S008", "expected a field, found `}`", notes=("a record has fields",)
                )
            field = self.name("the name of a field")
            self.expect(":", f"after the field `{visible(field.text)}`")
            entries.append((field, self._type("the type of the field")))
            if not self.comma("}", "the field", opener):
                break
        return tree.RecordTypeExpr(self.span_from(self.starts[opener]), tuple(entries))

    # ------------------------------------------------------------ intervals and sets

    def interval(self, what: str) -> tree.Interval:
        """`[low, high]`; fails where the bracket is missing."""
        opener = self.i
        if self.kinds[opener] != "[":
            raise self.failure(
                "S005",
                f"expected {what} as `[low, high]`, found {self.found()}",
                helps=("an interval is written with brackets, ends included: `[-1.0, 1.0]`",),
            )
        self.i += 1
        self.strict = True
        low = self.expression(_ANY)
        if self.kinds[self.i] == "..":
            self.report(
                "S005",
                "expected `,` between the ends of the interval, found `..`",
                helps=("an interval is written `[low, high]`",),
            )
            self.i += 1
        else:
            self.expect(",", "between the ends of the interval", opener=opener)
        high = self.expression(_ANY)
        self.strict = False
        if self.kinds[self.i] == ")":
            self.report(
                "S005",
                "expected `]` after the interval, found `)`",
                notes=("intervals include both ends",),
            )
            self.i += 1
        else:
            self.expect("]", "after the interval", opener=opener)
        return tree.Interval(low, high, self.span_from(self.starts[opener]))

    def value_set(self) -> tree.Interval | tree.RecordSet:
        """An interval, or one set per field of a record."""
        opener = self.i
        if self.kinds[opener] != "{":
            return self.interval("a set of values")
        self.depth += 1
        if self.depth > LEVELS_MAX:
            self._too_deep("set")
        self.i += 1
        entries: list[tuple[tree.Name, tree.Interval | tree.RecordSet]] = []
        while True:
            field = self.name("the name of a field")
            if self.kinds[self.i] == ":":
                self.report(
                    "S005",
                    f"expected `in` after the field `{visible(field.text)}`, found `:`",
                    helps=(f"write `{visible(field.text)} in [low, high]`",),
                )
                self.i += 1
            else:
                self.expect("in", f"after the field `{visible(field.text)}`")
            entries.append((field, self.value_set()))
            if not self.comma("}", "the field", opener):
                break
        self.depth -= 1
        return tree.RecordSet(tuple(entries), self.span_from(self.starts[opener]))


def _period_of(rate: tree.IntLit | tree.FloatLit) -> str:
    """The period of a rate in Hz, as it would be written."""
    if not 1e-3 < rate.value < 1e9:
        return "10ms"
    period_ms = 1e3 / rate.value
    return f"{period_ms:g}ms" if period_ms >= 1.0 else f"{round(period_ms * 1e6)}ns"


def type_meant(name: str) -> str | None:
    """The built-in type somebody probably means by the unknown type `name`."""
    return _TYPE_MEANT.get(name)


def height(expr: tree.Expr) -> int:
    """Levels of an expression tree, without recursion; stops counting past `LEVELS_MAX`."""
    level = 0
    row: list[tree.Expr] = [expr]
    while row and level <= LEVELS_MAX:
        level += 1
        row = [child for parent in row for child in children(parent)]
    return level


def children(expr: tree.Expr) -> list[tree.Expr]:
    """The expressions directly inside `expr`, in source order."""
    found: list[tree.Expr] = []
    for field in fields(expr):
        value = getattr(expr, field.name)
        if isinstance(value, tree.Expr):
            found.append(value)
        elif isinstance(value, tree.Interval):
            found += [value.low, value.high]
        elif isinstance(value, tuple):
            for part in value:
                if isinstance(part, tree.Expr):
                    found.append(part)
                elif isinstance(part, tuple):
                    found.extend(p for p in part if isinstance(p, tree.Expr))
    return found
