"""Parses bodies of declarations: `{ items }`, each item led by a word.

Purpose: `BodyParser` has what nodes, modules, plants, systems and tests share: the loop over items
with its recovery, unknown words, items that may stand once, lists of names, types, ranges, `from`.
Non-goals: the items themselves (`declarations.py`, `modules.py`, `systems.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from soter.diagnostics.diagnostic import Edit, Fix, Span
from soter.diagnostics.fixes import append, remove, replace
from soter.language.syntax import tree
from soter.language.syntax.lexer import EOF, NAME, STRING, printable, string_value
from soter.language.syntax.parsing.items import Parts, clauses, time
from soter.language.syntax.parsing.literals_and_operators import report_unclosed
from soter.language.syntax.parsing.statements import PLACE_FOLLOWS, StatementParser
from soter.language.syntax.parsing.token_cursor import BODY_WORDS, STATEMENT_WORDS, Panic
from soter.language.syntax.parsing.types import type_expression
from soter.language.syntax.their_words import THEIRS

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.diagnostics.diagnostic import Help
    from soter.language.syntax.lexer import Tokens
    from soter.language.syntax.parsing.items import Item, Items, Step

    Other = Callable[["BodyParser", Parts], bool] | None
    """Tries to read an item that no word leads."""

#: Items of a kind of body that no word leads, as lists of items name them.
LEADERLESS: dict[str, tuple[str, ...]] = {}


#: By which item a system or a test names what is declared by a word.
_ITEM_OF = {"node": "node", "rta": "module", "system": "system"}


class BodyParser(StatementParser):
    """The part of the parser that reads bodies of any kind."""

    __slots__ = ("broken", "declared", "loops")

    def __init__(self, tokens: Tokens) -> None:
        super().__init__(tokens)
        self.broken: set[str] = set()  # names of declarations that lost something
        self.declared: tree.Name | None = None  # by the declaration at hand
        self.loops = 0  # around the items at hand

    def declare(self, subject: str) -> tree.Name:
        """Reads the name of the declaration that is being parsed, and remembers it."""
        self.declared = self.name(subject)
        return self.declared

    # ------------------------------------------------------------ items

    def _open_body(self, subject: str, items: Items) -> int:
        """Steps over the `{` of a body; gives the index of `{`, or of the token in its place."""
        if self.kinds[self.i] == "{":
            self.opened.append(self.take())
            return self.i - 1
        self.report("S005", f"expected `{{` to begin the body of {subject}, found {self.found()}")
        stop = self.item_end()
        if self.texts[self.i] not in items or self.kinds[stop] == "{":
            self.damaged = True
            self.skip_expression(self.i, stop_at_brace=True)
            if self.kinds[self.i] == "{":
                self.opened.append(self.take())
                return self.i - 1
            if self.texts[self.i] not in items:
                raise Panic
        return self.i - 1

    def body(self, subject: str, items: Items, other: Other = None) -> Parts:
        """Parses `{ items }` by the table `items` of leading words; `other` parses other items."""
        parts = Parts()
        opener = self._open_body(subject, items)
        outer, self.items = self.items, frozenset(items)
        self._parse_items(opener, subject, parts, items, other)
        self.items = outer
        return parts

    def _parse_items(
        self, opener: int, subject: str, parts: Parts, items: Items, other: Other
    ) -> None:
        while True:
            if self.accept("}"):
                return
            kind = self.kinds[self.i]
            if kind == EOF or self.is_at_declaration():
                if kind != EOF and self.is_nested_declaration():
                    self.skip_misplaced_declaration()
                    continue
                self.damaged = True
                report_unclosed(self, opener, subject)
                return
            if kind == ";":
                self.skip_stray_semicolons()
                continue
            before = self.i
            try:
                if other is None or not other(self, parts):
                    item = items.get(self.texts[before])
                    if item is not None:
                        self._report_sign_after_word(before)
                        self._parse_item(item, parts)
                    else:
                        self._report_unknown_item(subject, parts, items)
                assert self.i > before, "whoever reads an item goes on"
            except Panic:
                self.damaged = True
                self.depth = self.blocks = 0
                if self.i == before:
                    self.advance()
                self.skip_statement()
                while self.kinds[self.i] == ";":  # behind a block that was skipped
                    self.i += 1

    def _report_sign_after_word(self, word: int) -> None:
        """Reports the sign in `period: 50ms;` or `period = 50ms;`, and takes it out."""
        sign = self.kinds[word + 1]
        if sign in (":", "="):
            self.i = word + 1
            self.report(
                "S005",
                f"no `{sign}` after `{self.texts[word]}`",
                helps=(self._fix_without_token(word + 1),),
                once=False,
            )
            # The item steps over one token, which is now the sign in place of its word.
            self.texts[word + 1], self.kinds[word + 1] = self.texts[word], self.kinds[word]

    def _fix_without_token(self, index: int) -> Fix:
        """Gives the edit that leaves one token out, with the blanks around it."""
        start, end = self.ends[index - 1], self.starts[index + 1]
        return replace(Span(self.source, start, end), " ", "leave it out")

    def _parse_item(self, item: Item, parts: Parts) -> None:
        """Parses the item whose word is at the cursor, and adds its values to `parts`."""
        at, word = self.i, self.texts[self.i]
        self.i += 1
        read = item.read(self, word, self.starts[at])
        if item.how == "once":
            self._keep_once(item, parts, read, at)
            return
        if item.how == "loop":
            for field, value in read.items():
                parts.several[field].append(value)
            return
        (field,) = item.defaults
        for value in read if item.how == "each" else (read,):
            parts.several[field].append(value)

    def _report_unknown_item(self, subject: str, parts: Parts, items: Items) -> None:
        word, kind = self.texts[self.i], self.kinds[self.i]
        if word == "period" and subject == self.without_period:
            raise Panic  # that it stands before the body was told
        if word == "polytope" and "grid" in items:
            raise self.failure(
                "S026",
                "half-spaces (`polytope`) are gone since 1.0.0",
                notes=("states that follow others need a grid of one cell, docs/autopilot.md, 3",),
                helps=("write a `grid`, and where that is too dear `rest`",),
            )
        message = f"expected an item of {subject}, found {self.found()}"
        if self._is_at_loose_statement():
            self._skip_loose_statements(message, items)
            return
        known = word in THEIRS or not word.isidentifier()
        near = None if known else self.word_close_to(word, items)
        if near is not None:
            self._parse_as(near, message, parts, items)
            return
        help_ = self._help_for_missing_word(word, items)
        if help_ is not None:
            raise self.failure("S010", message, helps=(help_,))
        if kind == NAME and self.kinds[self.i + 1] in PLACE_FOLLOWS:
            self._skip_loose_statements(message, items)
            return
        notes = (_item_list(subject.partition(" `")[0], items),)
        raise self.failure("S010", message, notes=notes)

    def _is_at_loose_statement(self) -> bool:
        """Whether a statement begins at the cursor, and not `publish` with a list of topics."""
        kind = self.kinds[self.i]
        return kind in STATEMENT_WORDS and not (kind == "publish" and self._has_only_names())

    def _help_for_missing_word(self, word: str, items: Items) -> Help | None:
        """Gives the help for a lacking word: before `invariant(M);` or, in a system, `House;`."""
        if word in ("invariant", "invariants") and "always" in items:
            return self._advice_to_write_always(items)
        alone = self.kinds[self.i] == NAME and self.kinds[self.i + 1] == ";"
        if alone and not {"system", "until"}.isdisjoint(items):
            return self._lone_name_help(word, items)
        return None

    def _parse_as(self, word: str, message: str, parts: Parts, items: Items) -> None:
        """Reports the word at the cursor, and reads the item as if `word` led it."""
        helps = (replace(self.token_span(self.i), word, f"did you mean `{word}`?"),)
        self.report("S010", message, helps=helps, once=False)
        self.texts[self.i] = word
        self._parse_item(items[word], parts)

    def _lone_name_help(self, word: str, items: Items) -> Help:
        """Gives the help `system House;` for `House;`, by the kind of declaration of this name."""
        kinds, texts = self.kinds, self.texts
        declared = {k for i, k in enumerate(kinds[:-1]) if texts[i + 1] == word and k in _ITEM_OF}
        item = _ITEM_OF[declared.pop()] if len(declared) == 1 else None
        if item in items:
            return replace(self.token_span(self.i), f"{item} {word}", f"write `{item} {word};`")
        name = printable(word)
        if "module" not in items:
            return f"write `system {name};`"
        return f"write `node {name};`, `module {name};`, or `c: {name};` for a plant"

    def _advice_to_write_always(self, items: Items) -> str:
        """Gives the advice to write `invariant(M);` as a property: `always invariant(M);`."""
        at = self.i
        while self.kinds[at] in (NAME, ".", "(", ")"):
            at += 1
        text = printable("".join(self.texts[self.i : at]))
        where = "" if "eventually" in items else " in a `test` block"
        return f"write `always {text};`{where}"

    def _skip_loose_statements(self, message: str, items: Items) -> None:
        """Reports statements outside of a `step { ... }` with one error, and skips them."""
        in_a_node = "step" in items
        note = "statements stand inside a `step { ... }` block of a node, or in a function"
        self.report("S010", message, notes=(note,))
        self.damaged = True
        while not in_a_node and self._is_at_statement() and self.texts[self.i] not in items:
            self.advance()
            self.skip_statement()
        while self._is_at_statement() and self.texts[self.i] not in items:
            self.quiet = -1
            self._parse_or_recover([], self.kinds[self.i])
        after = self.i + 1
        if (
            in_a_node
            and self.kinds[self.i] == "}"
            and (self.kinds[after] == "}" or self.texts[after] in items)
        ):
            self.i += 1  # only the opening of the block was missing

    def _has_only_names(self) -> bool:
        """Whether only names follow the word `publish`, so `publishes` was meant."""
        i = self.i + 1
        while self.kinds[i] in (NAME, ".", ","):
            i += 1
        return self.kinds[i] in (";", "}") or self.kinds[i] in BODY_WORDS

    def _keep_once(self, item: Item, parts: Parts, read: Any, at: int) -> None:  # noqa: ANN401
        """Keeps the value of an item that may occur only once, or reports its second occurrence."""
        title, span = item.told or self.texts[at], self.token_span(at)
        if title in parts.first:
            self.quiet = -1
            also = ((parts.first[title], "the first one"),)
            self.report(
                "S022", f"`{title}` stands twice in this body", span, "again", also=also, once=False
            )
            return
        parts.first[title] = span
        values = (read,) if len(item.defaults) == 1 else read
        parts.once.update(zip(item.defaults, values, strict=True))

    def refs(self, subject: str) -> list[tree.Ref]:
        """Parses one or more names, separated by commas."""
        refs = [self.ref(subject)]
        while self.accept(",") or self.accept_forgotten_comma():
            refs.append(self.ref(subject))
        return refs

    def accept_forgotten_comma(self) -> bool:
        """Whether a comma was forgotten between two names, as in `a b`; if so, reports it."""
        i = self.i
        if (
            self.kinds[i] != NAME
            or self.is_on_new_line()
            or self.kinds[i + 1] not in (",", ";", ".")
        ):
            return False
        message = f"expected `,` or `;` after the name, found {self.found()}"
        if self.kinds[i + 1] != "." and not self._is_topic_of_file(self.texts[i]):
            gone = Span(self.source, self.ends[i - 1], self.ends[i])
            out = replace(gone, "", f"leave `{printable(self.texts[i])}` out")
            self.report("S005", message, label="no topic is called so", helps=(out,), skip=1)
            return self.accept(",")
        self.report("S005", message, self.after_previous(), "`,` is missing here")
        return True

    def _is_topic_of_file(self, word: str) -> bool:
        """Whether the file declares a topic of this name, as far as it looks."""
        pairs = zip(self.kinds, self.texts[1:], strict=False)
        return any(kind == "topic" and text == word for kind, text in pairs)

    def parse_head_of(
        self, kind: str, name: tree.Name, *, extern: bool
    ) -> tuple[tree.SyntaxExpr, tree.SyntaxExpr | None, str | None, Span | None]:
        """Reads period, phase and `from` in the head of a node or plant, in any order."""
        rows: dict[str, Step] = {"period": time("`period`"), "from": BodyParser._parse_origin}
        rows |= {"phase": time("`phase`")} if kind == "node" else {}
        if not extern:
            rows.pop("from")
        found = clauses(self, kind, rows)
        if "period" not in found:
            found |= {"period": self.period(kind, name), **clauses(self, kind, rows)}
        origin = found.get("from", (None, None)) if extern else self.refuse_stray_origin(kind)
        return found["period"], found.get("phase"), *origin

    def period(self, kind: str, name: tree.Name) -> tree.SyntaxExpr:
        """Reads the period in the head of a declaration; gives an ErrorExpr if it is missing."""
        word = self.texts[self.i]
        example = f"write `{kind} {printable(name.text)} period 10ms {{ ... }}`"
        message = f"expected `period` after the name of the {kind}, found {self.found()}"
        self.without_period = f"{kind} `{name.text}`"
        span = self.after_previous() if self.kinds[self.i] == "{" else None
        self.report("S005", message, span, helps=(self._period_inside(kind, name) or example,))
        if self.kinds[self.i] == NAME and self.kinds[self.i + 1] != "{" and word != "from":
            self.i += 1
            self.quiet = -1
            return self.time("`period`")
        return tree.ErrorExpr(self.after_previous())

    def _period_inside(self, kind: str, name: tree.Name) -> Fix | None:
        """Gives the edit that moves `period 20ms;` from the body to the head; None if not found."""
        depth, i = 0, self.i
        while self.kinds[i] != EOF and not (depth == 0 and i > self.i):
            depth += (self.kinds[i] == "{") - (self.kinds[i] == "}")
            begins = self.kinds[i - 1] in ("{", ";", "}")
            if depth == 1 and begins and self.texts[i] == "period" and self.kinds[i + 2] == ";":
                written = Span(self.source, self.starts[i], self.ends[i + 2])
                head = f"period {self.texts[i + 1]}"
                title = f"write `{kind} {printable(name.text)} {head} {{ ... }}`"
                moved = append(name.span, f" {head}", title)
                return Fix(title, (*moved.edits, *remove(written, title).edits))
            i += 1
        return None

    # ------------------------------------------------------------ common parts

    def typed(self, owner: str) -> tree.TypeExpr:
        """Parses `: type` after the name of `owner`."""
        if self.accept(":"):
            return type_expression(self, f"the type of {owner}")
        self.report(
            "S005",
            f"expected `:` and a type after the name of {owner}, found {self.found()}",
            self.after_previous(),
            "the type is missing here",
        )
        kind = self.kinds[self.i]
        if kind in ("float", "int", "bool", "duration") or (
            kind == NAME and self.kinds[self.i + 1] in ("=", "in", ";", ",", ")", "[")
        ):
            self.quiet = -1
            return type_expression(self, f"the type of {owner}")
        return tree.ErrorTypeExpr(self.after_previous())

    def range_of(self, subject: str) -> tree.IntervalExpr:
        """Parses an interval; gives an interval of two ErrorExprs if this fails."""
        start = self.i
        try:
            return self.interval(subject)
        except Panic:
            self.depth = 0
            self.skip_interval(start)
            span = self.span_from(self.starts[start])
            return tree.IntervalExpr(tree.ErrorExpr(span), tree.ErrorExpr(span), span)

    def skip_interval(self, start: int) -> None:
        """Steps past the `]` that closes the interval, if it comes before the item ends."""
        level = self.kinds[start : self.i].count("[") - self.kinds[start : self.i].count("]")
        while self.kinds[self.i] not in (";", "}", "{", EOF, "=") and not self.is_at_declaration():
            kind = self.kinds[self.i]
            level += (kind == "[") - (kind == "]")
            self.i += 1
            if kind == "]" and level <= 0:
                break
        self.quiet = self.i

    def origin(self) -> tuple[str | None, Span | None]:
        """Parses `from "..."` of an extern declaration, if it is there."""
        return self._parse_origin() if self.accept_word("from") else (None, None)

    def _parse_origin(self) -> tuple[str | None, Span | None]:
        if self.kinds[self.i] != STRING:
            self.report(
                "S005",
                f"expected a string after `from`, found {self.found()}",
                helps=('write `from "python:policy.py:step"`',),
            )
            self.damaged = True
            return None, None
        i = self.take()
        return string_value(self.texts[i]), self.token_span(i)

    def fix_without_extern(self, start: int, origin: Span | None) -> Fix:
        """Gives the edit that removes `extern` at `start`, and the `from "..."` at `origin`."""
        text = self.source.text
        end = start + len("extern")
        end += len(text[end:]) - len(text[end:].lstrip())
        edits = [Edit(Span(self.source, start, end), "")]
        if origin is not None:
            before = len(text[: text.rindex("from", 0, origin.start)].rstrip())
            edits.append(Edit(Span(self.source, before, origin.end), ""))
        words = "`extern` and `from`" if origin is not None else "`extern`"
        return Fix(f"leave {words} out", tuple(edits))

    def refuse_stray_origin(self, kind: str) -> tuple[str | None, Span | None]:
        """Reports and skips a `from` after a declaration that is not extern."""
        if self.is_word("from"):
            message = "only what is `extern` comes from elsewhere"
            self.report("S025", message, helps=(f"write `extern {kind} ...`",))
            self.damaged = True
            self.origin()
        return None, None


def _item_list(sort: str, items: Items) -> str:
    """Gives a sentence with the kinds of items that a body may have."""
    known = [*(f"`{w}`" for w in items), *LEADERLESS.get(sort, ())]
    return f"the items of {sort} are {', '.join(known)}"
