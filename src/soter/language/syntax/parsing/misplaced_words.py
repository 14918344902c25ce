"""Reports words of Soter where they do not belong, and tries edits.

Purpose: handles clauses in the wrong order, clauses of a topic after its name in a node, and items
in another body. It parses the text with each edit before it offers the edit.
Non-goals: where words belong (`words.py`); phrases of other languages
(`foreign_phrases.py`).
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Edit, Fix, Label, Source, Span, applied, made, replace
from soter.language.syntax.tokens import DURATION, EOF, FLOAT, INT, NAME, STRING, lex
from soter.language.syntax.words import (
    PLANT,
    SYSTEM,
    TEST,
    body_of,
    is_clause,
    misplaced,
    places,
)

if TYPE_CHECKING:
    from soter.diagnostics.codes import Code
    from soter.diagnostics.diagnostic import Diagnostic, Help
    from soter.language.syntax.parsing.token_cursor import Cursor

TRIED_MAX = 400_000
"""Most characters that are parsed again to try edits in one file."""

_SHOWN_MAX = 90
"""Most characters of a line that a message shows."""

_LEADERS = frozenset([
    "topic", "param", "state", "disturbance", "const", "var", "let", "input", "measure", "external",
    "node", "plant", "late", "overrun", "bias", "noise", "scale", "skip", "nan", "stuck", "silent",
    "saturated", "grid", "subscribes", "publishes", "reads", "drives", "publish", "type", "fun",
    "measured", "rta", "system", "test",
])  # fmt: skip
"""Words of items and statements of which it is said that a clause does not belong behind them."""
_CLOSERS = {"}": "{", "]": "[", ")": "("}
_SAME_LINE = frozenset(["S004", "S005", "S007", "S016"])
_ITEMS = frozenset(["S009", "S010", "S011"])


def may_try(cursor: Cursor) -> bool:
    """Whether the file may be parsed once more."""
    return cursor.tried + len(cursor.source.text) <= TRIED_MAX


def leads_on(cursor: Cursor, fix: Fix, start: int, end: int) -> bool:
    """Whether no syntax error stands between two offsets of the text that an edit makes.

    True where so many edits were tried before that this one is not.
    """
    text = cursor.source.text
    if not may_try(cursor):
        return True
    cursor.tried += len(text)
    (written,) = applied(fix).values()
    trial = type(cursor)(lex(Source(cursor.source.name, written)))
    trial.tried = TRIED_MAX
    trial.file()
    end += len(written) - len(text)
    problems = trial.tokens.problems + trial.problems
    spans = [d.primary.span for d in problems if d.primary]
    return not any(start < max(s.end, s.start + 1) and s.start < end for s in spans)


def out_of_place(
    cursor: Cursor, code: Code, notes: tuple[str, ...], helps: tuple[Help, ...]
) -> Diagnostic | None:
    """What is said in the place of an error at the cursor; None if nothing.

    What the error itself has to say of an item or a statement is kept: an edit in any case, a note
    on a lost brace beside.
    """
    if code in _SAME_LINE:
        leader = _leader(cursor)
        in_a_head = leader is not None and cursor.texts[leader] in ("node", "plant")
        if cursor.new_line() or (helps and in_a_head):
            return None
    elif code not in _ITEMS or helps:
        return None
    return _elsewhere(cursor, code, tuple(n for n in notes if "`}`" in n))


def _leader(cursor: Cursor) -> int | None:
    """The word that leads the item or statement at the cursor."""
    kinds, texts = cursor.kinds, cursor.texts
    level = 0
    for i in range(cursor.i - 1, max(cursor.i - 80, -1), -1):
        kind = kinds[i]
        if kind in _CLOSERS:
            level += 1
        elif kind in ("{", "[", "("):
            level -= level > 0
        elif level == 0 and kind == ";":
            return None
        elif level == 0 and texts[i] in _LEADERS and _first(cursor, i):
            return i
    return None


def _first(cursor: Cursor, i: int) -> bool:
    """Whether an item or a declaration begins at a token."""
    before = cursor.texts[i - 1] if i else ";"
    return before in (";", "{", "}", "input", "extern") or cursor.first_on_line(i)


def _clause_end(cursor: Cursor, leader: int, ends: tuple[str, ...]) -> int:
    """The token behind what a word leads: one of `ends` outside of brackets, or a bracket."""
    level = 0
    i = leader + 1
    while (kind := cursor.kinds[i]) != EOF and not (level == 0 and kind in ends):
        if kind in ("{", "[", "("):
            level += 1
        elif kind in _CLOSERS:
            if level == 0:
                break
            level -= 1
        i += 1
    return i


# ---------------------------------------------------------------- one token


_EXPECTED = re.compile(r"expected (?:`([^`]+)`|:)(?: or `([^`]+)`)?")
_INSERTED = frozenset(["=", ":", ",", ")", "]", "by", "in", "within", "every", "as", "takeover"])
#: What people put between words, and no value: it may be left out, or stand for what is expected.
_FILLERS = frozenset(
    ["=", ":", ",", "->", "=>", "/", "with", "to", "of", "is", "be", "then", "do", "at", "struct",
     "record", "the", "from", "using", "by", "as", "==", ":=", "class"]
)  # fmt: skip


_VALUES = frozenset([NAME, INT, FLOAT, DURATION, STRING, "(", "[", "{", "true", "false", "float",
                     "int", "bool", "duration", "-"])  # fmt: skip
_ASSIGNMENT = re.compile(r"expected `=` after `\w+`")


def _edits(cursor: Cursor, code: Code, message: str) -> list[Edit]:
    """What may have been meant by the token at the cursor, to be tried in this order."""
    kind, word = cursor.kinds[cursor.i], cursor.texts[cursor.i]
    token = cursor.token_span(cursor.i)
    found = _EXPECTED.match(message)
    expected = [e for e in (found.groups() if found else ()) if e in _INSERTED]
    edits: list[Edit] = []
    if word in _FILLERS and not (code == "S007" and word != ":"):
        edits += [Edit(token, e) for e in expected if e != word and (e, word) != (":", ",")]
        edits.append(Edit(token, ""))
    elif kind == STRING:
        edits.append(Edit(token, word.strip('"')))
    if kind in _VALUES and not _ASSIGNMENT.match(message):
        before = Span(cursor.source, token.start, token.start)
        edits += [Edit(before, f"{e} ") for e in expected]
    return edits


def repaired(cursor: Cursor, code: Code, message: str) -> Fix | None:
    """The item at the cursor with one token more, less or other, where that makes it right."""
    text = cursor.source.text
    token = cursor.token_span(cursor.i)
    line = text.rfind("\n", 0, token.start) + 1
    stop = text.find("\n", token.end)
    stop = len(text) if stop < 0 else stop
    following = max(text.find("\n", stop + 1), stop)
    for edit in _edits(cursor, code, message):
        if not may_try(cursor):
            return None
        fix = Fix("", (edit,))
        if leads_on(cursor, fix, line, following):
            (written,) = applied(fix).values()
            shown = " ".join(written[line : stop + len(written) - len(text)].split())
            if len(shown) < _SHOWN_MAX:
                return Fix(f"write `{_tidy(shown)}`", (edit,))
            put = f"write `{edit.text}`" if edit.span.text else f"put `{edit.text.strip()}` here"
            return Fix(put if edit.text else "leave it out", (edit,))
    return None


def _tidy(line: str) -> str:
    """A line without blanks before signs, its body left out, as far as its item goes."""
    line = re.sub(r" +([:;,)\]])", r"\1", re.sub(r"\( +", "(", line))
    line = re.sub(r"(?<=[\w)\]])=(?= )", " =", line)
    return re.sub(r"\{[^{}=:]*$", "{ ... }", line)


# ---------------------------------------------------------------- words of elsewhere


def item_end(cursor: Cursor) -> int:
    """The token that ends the item at the cursor, or the brace that opens its block."""
    i = cursor.i
    while cursor.kinds[i] not in (";", "{", "}", EOF):
        i += 1
    return i


def at_word_of_elsewhere(cursor: Cursor) -> bool:
    """Whether a word that leads an item of another body stands here, and not a name."""
    word = cursor.texts[cursor.i]
    elsewhere = cursor.blocks > 0 or word not in cursor.items
    rest = cursor.source.text[cursor.ends[cursor.i] :][:40]
    return elsewhere and is_clause(word, rest) and word in places()


def _elsewhere(cursor: Cursor, code: Code, notes: tuple[str, ...]) -> Diagnostic | None:
    i = cursor.i
    word = cursor.texts[i]
    here = word in cursor.items and cursor.blocks == 0
    if here or not is_clause(word, cursor.source.text[cursor.ends[i] :][:40]):
        return None
    leader = _leader(cursor) if code in _SAME_LINE else None
    item = "" if leader is None else cursor.texts[leader]
    written = cursor.source.text[cursor.starts[i] : cursor.ends[item_end(cursor)]]
    if (item, word) == ("disturbance", "hold"):
        return None  # the range before it is missing, which the caller says
    said = misplaced(word, body_of(cursor.items, cursor.blocks), item, written)
    if said is None:
        return None
    help_: Help = _to_the_topic(cursor) or said.help
    span = cursor.token_span(i)
    if word == "on":
        span = span.to(cursor.token_span(i + 1))
    shown = code if code in _ITEMS else "S010"
    return made(shown, said.message, Label(span), (), (said.note, *notes), (help_,))


def _to_the_topic(cursor: Cursor) -> Fix | None:
    """`max_age` or a set behind the name of a topic of this file, moved to its declaration."""
    i = cursor.i
    word, name = cursor.texts[i], cursor.texts[i - 1]
    if word not in ("max_age", "in") or cursor.kinds[i - 1] != NAME:
        return None
    text = cursor.source.text
    declared = re.search(rf"^(?:input\s+)?topic\s+{name}\b[^;{{}}]*;", text, re.MULTILINE)
    if declared is None:
        return None
    end = _clause_end(cursor, i, (",", ";"))
    gone = Span(cursor.source, cursor.ends[i - 1], cursor.ends[end - 1])
    if re.search(rf"\b{word}\b", declared[0]):
        title = f"leave it out: the declaration of topic `{name}` says it already"
        return Fix(title, (Edit(gone, ""),))
    clause = text[cursor.starts[i] : cursor.ends[end - 1]]
    before = re.search(r"\s*(?:=|\bmax_age\b|;)" if word == "in" else r"\s*;", declared[0])
    if before is None or cursor.kinds[end] not in (",", ";"):
        return None
    at = declared.start() + before.start()
    line = f"{text[declared.start() : at]} {clause}{text[at : declared.end()]}"
    edits = (Edit(gone, ""), Edit(Span(cursor.source, at, at), f" {clause}"))
    fix = Fix(f"move it to the topic: `{' '.join(line.split())}`", edits)
    return fix if leads_on(cursor, fix, gone.start, cursor.ends[end]) else None


# ---------------------------------------------------------------- assignments beside a step


def assigned(cursor: Cursor, body: str) -> tuple[Help, ...]:
    """The help on what to write for `x = e;` where no statements may stand."""
    name, follows = cursor.texts[cursor.i], cursor.kinds[cursor.i + 1]
    if follows not in ("=", ":=") or body not in (PLANT, SYSTEM, TEST):
        return ()
    end = _clause_end(cursor, cursor.i, (";",))
    whole = Span(cursor.source, cursor.starts[cursor.i], cursor.ends[end - 1])
    value = cursor.source.text[cursor.starts[cursor.i + 2] : whole.end]
    if cursor.kinds[end] != ";":
        return ()
    if body != PLANT:
        words = ["set"] if _declared(cursor, "param", name) else []
    else:
        words = ["next", "der"] if _declared(cursor, "state", name) else ["let"]
    helps: list[Help] = []
    for word in words:
        slope = value if word != "der" else _slope(name, value)
        if slope is None:
            if word == "der":
                helps.append(f"or its derivative, `der {name} = ...;`")
            continue
        fix = replace(whole, f"{word} {name} = {slope}", f"write `{word} {name} = {slope};`")
        if leads_on(cursor, fix, whole.start, cursor.ends[end]):
            if word == "der":
                return (fix,)
            helps.append(fix)
    return tuple(helps)


def _declared(cursor: Cursor, word: str, name: str) -> bool:
    """Whether the file declares a name behind this word."""
    return re.search(rf"\b{word}\s+{name}\b", cursor.source.text) is not None


_STEP = r"(?:dt|DT|h|Ts|ts|delta_t|delta|period|seconds\([\w.]+\)|0\.\d+)"


def _slope(name: str, value: str) -> str | None:
    """The derivative in a step of Euler: `v` in `x + dt * v` and in `x + v * dt`."""
    for pattern in (rf"{name}\s*\+\s*{_STEP}\s*\*\s*(.+)", rf"{name}\s*\+\s*(.+?)\s*\*\s*{_STEP}"):
        match = re.fullmatch(pattern, value)
        if match is None:
            continue
        slope = match[1]
        if re.fullmatch(r"[\w.]+", slope):
            return slope
        if slope[0] == "(" and slope[-1] == ")":
            return slope[1:-1]
    return None
