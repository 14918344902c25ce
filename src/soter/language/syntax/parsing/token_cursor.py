"""The parser's position in the tokens, with reports and recovery.

Purpose: `Cursor` has what every part of the parser needs: look ahead, expect a token, report once,
and find a place from which parsing can go on. It does not report an error at a token where another
one was reported, so one mistake gives one message.
Non-goals: any rule of the grammar.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Fix, Label, Source, Span, make_diagnostic
from soter.diagnostics.fixes import append, apply_fix, replace
from soter.diagnostics.similar_names import closest
from soter.language.syntax.lexer import (
    DURATION,
    EOF,
    ERROR,
    FLOAT,
    INT,
    NAME,
    RESERVED,
    STRING,
    lex,
    printable,
)  # fmt: skip
from soter.language.syntax.their_words import foreign_word_at, helps_for_word
from soter.language.syntax.tree import DottedPath, Name, Ref

if TYPE_CHECKING:
    from collections.abc import Iterable

    from soter.diagnostics.codes import Code
    from soter.diagnostics.diagnostic import Diagnostic, Help
    from soter.language.syntax.lexer import Tokens
    from soter.language.syntax.tree import File

#: So many errors of one file are shown.
ERRORS_MAX = 100

#: Words that begin a statement; none of them can stand inside an expression.
STATEMENT_WORDS = frozenset(
    ["let", "var", "push", "publish", "return", "assert", "if", "for", "while", "else", "elseif"]
)

#: Reserved words that begin an item of a node or a plant.
ITEM_WORDS = frozenset(["subscribes", "publishes", "step", "state", "der", "next"])

#: Words that only make sense inside a body.
BODY_WORDS = ITEM_WORDS | {"period", "phase"}

_DECLARATION_WORDS = frozenset(
    ["type", "const", "param", "fun", "extern", "topic", "node", "rta", "plant", "system", "test",
     "import"]
)  # fmt: skip

#: What a thing is; where one is named its name stands alone.
_KIND_WORDS = frozenset(
    ["type", "const", "param", "fun", "topic", "node", "rta", "plant", "system"]
)

_LITERALS = frozenset([NAME, INT, FLOAT, DURATION, ERROR])


TRIED_MAX = 400_000
"""Most characters that are parsed again to try edits in one file."""

_SHOWN_MAX = 60
"""Most characters of an edited item that a message shows."""

_BETWEEN = "two values on a line have an operator between them, two items a `;`"
_TWO_ITEMS = "what follows the `,` is an item or a statement of its own, with a word of its own"


class Panic(Exception):  # noqa: N818 - control flow inside the parser, never seen outside
    """Raised when a construct cannot be parsed to its end; the catcher finds a place to go on."""


class TooManyErrorsError(Exception):
    """A file has more than ERRORS_MAX errors, so the rest of it is not parsed."""


class Cursor:
    """The tokens of one file and the parser's position among them."""

    __slots__ = (
        "before_equal",
        "blocks",
        "damaged",
        "depth",
        "ends",
        "i",
        "indent",
        "inner",
        "items",
        "kinds",
        "misused",
        "opened",
        "problems",
        "quiet",
        "source",
        "spaced",
        "starts",
        "strict",
        "texts",
        "tight",
        "tokens",
        "tried",
        "without_period",
    )

    def __init__(self, tokens: Tokens) -> None:
        self.tokens = tokens
        self.source = tokens.source
        self.kinds = tokens.kinds
        self.texts = tokens.texts
        self.starts = tokens.starts
        self.ends = tokens.ends
        self.problems: list[Diagnostic] = []
        self.i = 0
        self.quiet = -1  # no further error at this token
        self.depth = 0  # of expressions and types
        self.blocks = 0  # of nested statement blocks
        self.before_equal = False  # in a clause behind which `=` may begin another one
        self.strict = False  # in an interval or a size, where `=` is no slip for `==`
        self.inner = False  # inside a declaration that stands inside another one
        self.indent = 0  # of the declaration at hand
        self.items: frozenset[str] = frozenset()  # words that begin an item of the body at hand
        self.damaged = False  # the declaration at hand lost something
        self.without_period = ""  # "node `A`", whose head has no period: that was told
        self.misused: set[str] = set()  # reserved words the user takes for names
        self.tried = 0  # characters that were read again to try edits
        # For the printer: braces that open a block, brackets and signs that cling, and the
        # colons of `? :`, which do not.
        self.opened: list[int] = []
        self.tight: list[int] = []
        self.spaced: list[int] = []

    # ------------------------------------------------------------ spans

    def span_from(self, start: int) -> Span:
        """Gives the span from character `start` to the end of the token before the cursor."""
        end = self.ends[self.i - 1] if self.i else start
        return Span(self.source, start, max(start, end))

    def token_span(self, index: int) -> Span:
        """Gives the span of one token."""
        return Span(self.source, self.starts[index], self.ends[index])

    def after_previous(self) -> Span:
        """Gives the empty span right behind the token before the cursor."""
        end = self.ends[self.i - 1] if self.i else 0
        return Span(self.source, end, end)

    # ------------------------------------------------------------ reporting

    def found(self, index: int | None = None) -> str:
        """Gives the words for the token at `index` (default: the cursor) in messages."""
        at = self.i if index is None else index
        kind = self.kinds[at]
        if kind == EOF:
            return "the end of the file"
        if kind == STRING:
            return "a string"
        text = f"`{printable(self.texts[at])}`"
        return f"the keyword {text}" if kind in RESERVED else text

    def report(
        self,
        code: Code,
        message: str,
        span: Span | None = None,
        label: str = "",
        *,
        also: tuple[tuple[Span, str], ...] = (),
        notes: tuple[str, ...] = (),
        helps: tuple[Help, ...] = (),
        skip: int = 0,
        once: bool = True,
    ) -> None:
        """Reports an error at the cursor (or at `span`), and skips `skip` tokens.

        Only the first error at a token is reported, unless the error before had `once=False`.
        Raises TooManyErrorsError beyond `ERRORS_MAX` errors.
        """
        i = self.i
        silent = (
            i == self.quiet
            or i in self.tokens.bad
            or (self.kinds[i] == EOF and self.tokens.truncated)
        )
        self.quiet = i
        if not silent:
            if len(self.problems) >= ERRORS_MAX:
                raise TooManyErrorsError
            if span is None:
                span = self.token_span(i)
            labels = tuple(Label(s, t) for s, t in also)
            if not helps and (theirs := self._help_for_foreign_word()) is not None:
                span, helps, label = theirs[0], (theirs[1],), ""
            self.problems.append(
                make_diagnostic(code, message, Label(span, label), labels, notes, helps)
            )
        self.i += skip
        if not once:
            self.quiet = -1

    def _help_for_foreign_word(self) -> tuple[Span, Help] | None:
        """Gives the span of a foreign word at or before the cursor, and its help; else None."""
        for i in (self.i - 1, self.i):
            word = foreign_word_at(self.source.text, self.starts[i]) if i >= 0 else ""
            span = Span(self.source, self.starts[i], self.starts[i] + len(word))
            for help_ in helps_for_word(word, span):
                if isinstance(help_, str):
                    named = self.kinds[i + 1] == NAME
                    return span, help_.replace("Name", self.texts[i + 1]) if named else help_
                if (good := self._fix_that_parses(help_, i)) is not None:
                    return span, good
        return None

    def _fix_that_parses(self, fix: Fix, i: int) -> Fix | None:
        """Gives `fix`, an edit of token `i`, if the item then has no syntax error; else None.

        Also None if trials of edits have already cost TRIED_MAX characters in this file.
        """
        (written,) = apply_fix(fix).values()
        self.tried += len(written)
        if self.tried > TRIED_MAX:
            return None
        trial = type(self)(lex(Source(self.source.name, written)))
        trial.tried = TRIED_MAX
        trial.file()
        start = self.ends[i - 1] if i else 0
        stop = self.ends[self.item_end()] + len(written) - len(self.source.text)
        problems = trial.tokens.problems + trial.problems
        spans = [d.primary.span for d in problems if d.primary]
        if any(s.start < stop and start < max(s.end, s.start + 1) for s in spans):
            return None
        gone = fix.edits[0].text == ""
        first = i - 1 if i and not self.texts[i][0].isalnum() else i
        shown = " ".join(written[self.starts[first] : stop].split())[:_SHOWN_MAX]
        return Fix(f"{fix.title}: `{shown}`" if gone else f"write `{shown}`", fix.edits)

    def file(self) -> File:
        """Parses the whole file."""
        raise NotImplementedError

    def failure(
        self,
        code: Code,
        message: str,
        span: Span | None = None,
        label: str = "",
        *,
        also: tuple[tuple[Span, str], ...] = (),
        notes: tuple[str, ...] = (),
        helps: tuple[Help, ...] = (),
    ) -> Panic:
        """Reports as `report` does; gives a Panic for the caller to raise."""
        self.report(code, message, span, label, also=also, notes=notes, helps=helps)
        return Panic()

    # ------------------------------------------------------------ looking ahead

    def is_word(self, word: str) -> bool:
        """Whether the cursor is at this contextual word."""
        return self.texts[self.i] == word and self.kinds[self.i] == NAME

    def item_end(self) -> int:
        """Gives the index of the first token that ends the item at the cursor: `;`, `{` or `}`."""
        i = self.i
        while self.kinds[i] not in (";", "{", "}", EOF):
            i += 1
        return i

    def is_on_new_line(self) -> bool:
        """Whether the token at the cursor stands on another line than the token before it."""
        return not self.i or ("\n" in self.source.text[self.ends[self.i - 1] : self.starts[self.i]])

    def is_at_declaration(self) -> bool:
        """Whether a declaration begins here, judged by its first two or three tokens."""
        i, kinds = self.i, self.kinds
        kind = kinds[i]
        if kind == NAME:
            return self.texts[i] == "input" and kinds[i + 1] == "topic"
        if kind not in _DECLARATION_WORDS:
            return False
        following = kinds[i + 1]
        if kind == "extern":
            return following in ("fun", "node", "plant")
        if kind == "import":
            return following == STRING
        if following != NAME and following not in RESERVED:
            return False
        third = kinds[i + 2]
        if kind == "node":
            if third == NAME:
                return self.word_close_to(self.texts[i + 2], ["period"]) is not None
            return third in ("period", "phase") or (third == "{" and not self._is_instance(i))
        if kind == "system":
            return third == "{" or (third == NAME and self.texts[i + 2] == "default")
        return third != ";"

    def _is_instance(self, i: int) -> bool:
        """Whether an instance `node X { a = b }` is at `i`, rather than a node without a period."""
        if self.kinds[i + 3 : i + 5] == [NAME, NAME]:
            return self.texts[i + 3] == "set"
        wired = self.kinds[i + 3] == NAME and self.kinds[i + 4] in ("=", ":=")
        return wired or self.kinds[i + 4] == "."

    def word_close_to(self, word: str, words: Iterable[str]) -> str | None:
        """Gives the known word that `word` was probably meant to be; None if none is close."""
        near = closest(word.lower(), words, 0.75)
        return near[0] if near else None

    # ------------------------------------------------------------ expecting

    def advance(self) -> None:
        """Moves one token on, but never past the end."""
        if self.kinds[self.i] != EOF:
            self.i += 1

    def take(self) -> int:
        """Steps over the token at the cursor and gives its index; never call this at the end."""
        self.i += 1
        return self.i - 1

    def accept(self, kind: str) -> bool:
        """Whether a token of this kind is at the cursor; if so, steps over it."""
        here = self.kinds[self.i] == kind
        self.i += here
        return here

    def accept_word(self, word: str) -> bool:
        """Whether this contextual word is at the cursor; if so, steps over it."""
        here = self.is_word(word)
        self.i += here
        return here

    def expect(self, kind: str, where: str, *, opener: int | None = None) -> None:
        """Steps over a token of this kind; else reports "expected `kind` `where`", raises Panic."""
        if self.accept(kind):
            return
        also = ((self.token_span(opener), "opened here"),) if opener is not None else ()
        raise self.failure("S005", f"expected `{kind}` {where}, found {self.found()}", also=also)

    def expect_word(self, word: str, where: str) -> None:
        """Steps over this word, or a misspelt form, which it reports; otherwise raises Panic."""
        if self.texts[self.i] == word:
            self.i += 1
            return
        message = f"expected `{word}` {where}, found {self.found()}"
        if self.kinds[self.i] == NAME and self.word_close_to(self.texts[self.i], [word]):
            self.report("S005", message, helps=(replace(self.token_span(self.i), word),), skip=1)
            return
        raise self.failure("S005", message)

    def assign(self, where: str) -> None:
        """Steps over `=`; reports and accepts `:=`, `==` or `<-`; raises Panic for other tokens."""
        kind = self.kinds[self.i]
        if self.accept("="):
            return
        if kind in (":=", "==", "<-"):
            self.report(
                "S015",
                f"expected `=` {where}, found `{kind}`",
                helps=(replace(self.token_span(self.i), "=", "assignment is `=`"),),
                skip=1,
            )
            return
        raise self.failure("S005", f"expected `=` {where}, found {self.found()}")

    def expect_semicolon(self, after: str) -> None:
        """Steps over `;`; if it is missing, reports it where it belongs and goes on."""
        if self.accept(";"):
            return
        self.report_missing_semicolon(after)
        if not self.may_go_on():
            self.damaged = True
            self.skip_statement()

    def report_missing_semicolon(self, after: str, helps: tuple[Help, ...] = ()) -> None:
        """Reports that `;` is missing after the previous token."""
        message = f"expected `;` after {after}, found {self.found()}"
        if not helps and self.is_on_new_line() and self.may_go_on():
            helps = (append(self.after_previous(), ";", "put `;` here"),)
        notes: tuple[str, ...] = ()
        if self.is_on_new_line() or self.kinds[self.i] in ("}", EOF) or self.may_go_on():
            label = "`;` is missing here"
        else:
            label = f"{after} ends here"
            notes = (_TWO_ITEMS if self.kinds[self.i] == "," else _BETWEEN,)
        self.report("S004", message, self.after_previous(), label, notes=notes, helps=helps)

    def may_go_on(self) -> bool:
        """Whether a statement, an item or the end follows, so that no token must be skipped."""
        kind = self.kinds[self.i]
        return (
            kind in ("}", EOF)
            or kind in STATEMENT_WORDS
            or kind in ITEM_WORDS
            or self.texts[self.i] in self.items
            or ((kind in RESERVED or kind == NAME) and self.is_on_new_line())
            or self.is_at_declaration()
        )

    def name(self, subject: str) -> Name:
        """Parses a name; accepts a reserved word, reported once per word; else raises Panic."""
        i = self.i
        kind = self.kinds[i]
        if kind in (NAME, ERROR):  # an ERROR such as `3x` was reported
            self.i = i + 1
            return Name(self.texts[i], self.token_span(i))
        if kind in _KIND_WORDS and self._name_beside(i):
            return self._name_after_kind(subject)
        if kind in RESERVED and not self._begins_next_construct(i):
            return self.name_from_reserved_word(subject)
        raise self.failure("S006", f"expected {subject}, found {self.found()}")

    def _name_after_kind(self, subject: str) -> Name:
        """Parses the name in `ac node Fast`; reports the word `node`, and skips a body after it."""
        i = self.i
        name = self.texts[i + 1]
        in_place = self.kinds[i + 2] in ("period", "phase", "{")
        both = self.token_span(i).to(self.token_span(i + 1))
        help_: Help = replace(both, name, f"leave `{self.texts[i]}` out")
        if in_place:
            help_ = f"declare it at the top of the file, and name it here: `{name}`"
        label = "nothing is declared here" if in_place else "the name stands alone here"
        message = f"expected {subject}, found the keyword `{self.texts[i]}`"
        self.report("S006", message, label=label, helps=(help_,))
        self.i = i + 2
        if in_place:
            while self.kinds[self.i] not in ("{", "}", ";", EOF):
                self.i += 1
            if self.kinds[self.i] == "{":
                self.skip_braces()
            self.quiet = self.i
            self.damaged = True
        return Name(name, self.token_span(i + 1))

    def _name_beside(self, i: int) -> bool:
        """Whether a name follows the token at `i` on the same line."""
        between = self.source.text[self.ends[i] : self.starts[i + 1]]
        return self.kinds[i + 1] == NAME and "\n" not in between

    def name_from_reserved_word(self, subject: str) -> Name:
        """Takes the reserved word at the cursor as a name, and reports it the first time."""
        i = self.i
        word = self.texts[i]
        if word not in self.misused:
            self.report(
                "S006",
                f"expected {subject}, found the keyword `{word}`",
                label="this word is reserved",
                helps=() if self._name_beside(i) else (f"choose another name, such as `{word}_`",),
            )
            self.misused.add(word)
        self.i = i + 1
        return Name(word, self.token_span(i))

    def _begins_next_construct(self, i: int) -> bool:
        """Whether the reserved word at `i` probably begins the next construct, and is no name."""
        following = self.kinds[i + 1]
        return (self.texts[i] in STATEMENT_WORDS and following in _LITERALS) or (
            following in (EOF, "{") and self.is_on_new_line()
        )

    def ref(self, subject: str) -> Ref:
        """Parses `name` or `file.name`."""
        first = self.name(subject)
        if not self.accept("."):
            return Ref(None, first, first.span)
        second = self.name(f"a name after `{printable(first.text)}.`")
        return Ref(first, second, self.span_from(first.span.start))

    def path(self, subject: str) -> DottedPath:
        """Parses `name.name.name`."""
        first = self.name(subject)
        parts = [first]
        while self.accept("."):
            parts.append(self.name("a name after `.`"))
        return DottedPath(tuple(parts), self.span_from(first.span.start))

    def accept_comma(self, close: str, after: str, opener: int) -> bool:
        """Whether another element of a bracketed list follows.

        Steps over `,` or over `close`. Reports a missing comma if the next token looks like an
        element; raises Panic for other tokens.
        """
        if self.accept(close):
            return False
        if self.accept(","):
            return not self.accept(close)
        kind = self.kinds[self.i]
        message = f"expected `,` or `{close}` after {after}, found {self.found()}"
        if kind == ";" and close == "}" and self.kinds[self.i + 1] in (NAME, "}"):
            comma = replace(self.token_span(self.i), ",", "fields are separated by `,`")
            self.report("S005", message, helps=(comma,), skip=1)
            return not self.accept("}")
        also = ((self.token_span(opener), "opened here"),)
        if kind == NAME and close == "}" and self.kinds[self.i + 1] in (":", ",", "}"):
            self.report("S005", message, self.after_previous(), "`,` is missing here", also=also)
            return True
        raise self.failure("S005", message, also=also)

    # ------------------------------------------------------------ firm ground

    def skip_expression(self, start: int, *, stop_at_brace: bool = False) -> None:
        """Skips the rest of an expression that began at token `start`, to the expression's end."""
        kinds = self.kinds
        braces = kinds[start : self.i].count("{") - kinds[start : self.i].count("}")
        while True:
            kind = kinds[self.i]
            if kind in (";", EOF) or self._begins_item(kind):
                break
            if kind == "{":
                if stop_at_brace and braces <= 0:
                    break
                braces += 1
            elif kind == "}":
                if braces <= 0:
                    break
                braces -= 1
            elif self.is_at_declaration():
                break
            self.i += 1
        self.quiet = self.i

    def skip_statement(self) -> None:
        """Steps past the next `;` or block, or up to a `}`, a statement word or a declaration."""
        kinds = self.kinds
        while True:
            kind = kinds[self.i]
            if kind == ";":
                self.i += 1
                self.quiet = -1
                return
            if kind in ("}", EOF) or self._begins_item(kind):
                break
            if kind == "{":
                self.skip_braces()
                return
            if self.is_at_declaration():
                break
            self.i += 1
        self.quiet = self.i

    def _begins_item(self, kind: str) -> bool:
        """Whether a statement or an item seems to begin at the cursor inside an unfinished one."""
        if kind in STATEMENT_WORDS or kind in ITEM_WORDS:
            return True
        return self.texts[self.i] in self.items and kind != STRING and self.is_on_new_line()

    def skip_braces(self) -> None:
        """Steps past a balanced `{ ... }`, or up to a declaration that shows it is not closed."""
        kinds = self.kinds
        level = 0
        while True:
            kind = kinds[self.i]
            if kind == EOF or (level and self.is_at_declaration()):
                break
            self.i += 1
            if kind == "{":
                level += 1
            elif kind == "}":
                level -= 1
                if level <= 0:
                    self.quiet = -1
                    return
        self.quiet = self.i

    def skip_to_declaration(self) -> None:
        """Moves to the next declaration or the end of the file."""
        while self.kinds[self.i] != EOF and not self.is_at_declaration():
            self.i += 1
        self.quiet = self.i

    def is_nested_declaration(self) -> bool:
        """Whether the declaration at the cursor is indented as if it belonged to this one."""
        return not self.inner and self.line_indent(self.i) > self.indent

    def are_braces_closed(self, levels: int) -> bool:
        """Whether `levels` braces around the cursor are closed before the next declaration."""
        for i in range(self.i, len(self.kinds)):
            kind = self.kinds[i]
            levels += (kind == "{") - (kind == "}")
            if levels <= 0:
                return True
            if kind == EOF or (kind in _DECLARATION_WORDS and self.line_indent(i) <= self.indent):
                break
        return False

    def line_indent(self, index: int) -> int:
        """Gives how many blanks begin the line of a token."""
        line = self.source.line(self.source.line_of(self.starts[index]))
        return len(line) - len(line.lstrip())

    def is_first_on_line(self, index: int) -> bool:
        """Whether a token is the first of its line."""
        return self.line_indent(index) == self.source.column_of(self.starts[index]) - 1
