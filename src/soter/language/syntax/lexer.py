"""The lexer: makes tokens of text, keeping comments aside.

Purpose: `lex` follows `docs/grammar.ebnf`. It never fails: text that is no token is reported once
per run, and either left out or replaced by the token that was most likely meant, so that the parser
can go on. `bad` has the places that it reported, and the parser reports nothing there.
Non-goals: the meaning of literals beyond their shape; which contextual words are keywords where
(the parser asks by text); what a line that begins with `#` means (`hash_lines.py`).
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Label, Span, make_diagnostic
from soter.diagnostics.fixes import replace
from soter.language.syntax.hash_lines import explain_hash_line
from soter.language.syntax.their_words import THEIRS, foreign_word_at, helps_for_word

if TYPE_CHECKING:
    from soter.diagnostics.codes import Code
    from soter.diagnostics.diagnostic import Diagnostic, Help, Source


NAME = "NAME"
INT = "INT"
FLOAT = "FLOAT"
DURATION = "DURATION"
STRING = "STRING"
ERROR = "ERROR"  # a wrong literal that was already reported
EOF = "EOF"

#: Words that are never names. Every other word of the grammar is a name elsewhere.
RESERVED = frozenset(
    [
        "soter", "import", "as", "type", "enum", "const", "param", "fun", "extern",
        "topic", "node", "period", "phase", "subscribes", "publishes", "var", "step",
        "rta", "plant", "system", "test", "let", "if", "elseif", "else", "for", "in",
        "return", "assert", "publish", "true", "false", "bool", "float", "int",
        "duration", "state", "der", "next", "while", "choose",
    ]
)  # fmt: skip

#: Unit of a duration literal, in nanoseconds.
UNIT_NS = {
    "ns": 1,
    "us": 1_000,
    "ms": 1_000_000,
    "s": 1_000_000_000,
    "min": 60_000_000_000,
    "h": 3_600_000_000_000,
}

_ERRORS_MAX = 100  # after so many lexical errors the file is not Soter: stop reading

_LOOK_AHEAD = 5  # tokens behind the end, so that the parser may look ahead without a check

#: A word of the grammar where a statement begins with it and a name follows; a name elsewhere.
PUSH = "push"
#: Reserved words that begin something: names, too, where what stands beside them says so.
SOFT = frozenset(["next", "state", "period", "phase", "step", "type", "test"])
_OPERATOR = frozenset(
    ["=", ",", ".", "(", "[", "?", "+", "-", "*", "/", "%", "<", ">", "<=", ">=", "==", "!=", "&&",
     "||", ".."]
)  # fmt: skip
_NAME_FOLLOWS = _OPERATOR | {
    "!", "var", "let", "const", "param", "fun", "topic", "state", "next", "der", "test",
    "subscribes", "publishes", "publish", "for", "if", "elseif", "return", "assert",
}  # fmt: skip
_NAME_BEFORE = (_OPERATOR - {"("}) | {":", ";", ")", "]", "}", "in"}
_KIND_OF_WORD = {word: word for word in (*RESERVED, PUSH)}

_DIGITS = r"[0-9]+(?:_[0-9]+)*"
_FLOAT_TAIL = rf"(?:\.{_DIGITS})?(?:[eE][+-]?[0-9]+)?"
_OPERATOR_SIGNS = "\u2212\u2013\u00d7\u00f7\u2264\u2265\u2260\u2227\u2228\u00ac\u00b7\u22c5"
_GARBAGE = rf"[^ \t\r\nA-Za-z0-9_\"()\[\]{{}}<>=!&|+\-*/%?:;,.#'{_OPERATOR_SIGNS}]"
_TOKEN = re.compile(
    r"[ \t\r\n]*(?:"
    r"([A-Za-z_][A-Za-z0-9_]*(?!\w))"  # 1 word
    r"|(===|!==|\*\*=|:=|\+=|-=|\*=|/=|%=|->|=>|\*\*|\+\+|<>|::"
    r"|\.\.|<=|>=|==|!=|&&|\|\||[;,:(){}\[\]=+\-<>?!%*]|/(?![/*])|\.(?![0-9]))"  # 2 punctuation
    rf"|({_DIGITS}{_FLOAT_TAIL}(?:ns|us|ms|s|min|h)?(?!\w|\.(?!\.)))"  # 3 number
    r"|(//[^\n]*|/\*[\s\S]*?\*/)"  # 4 comment
    r'|("[^"\\\n]*(?:\\[^\n][^"\\\n]*)*")'  # 5 string
    r"|(\Z)"  # 6 end
    r"|([^\W\d]\w*)"  # 7 word with letters outside ASCII
    r"|((?:[0-9]|\.[0-9])(?:[eE][+-][0-9]|\.(?!\.)|\w)*)"  # 8 malformed number
    r'|("[^\n]*)'  # 9 unterminated string
    r"|(/\*[\s\S]*)"  # 10 unterminated comment
    r"|(#(?!(?:(?<=\b[Tt]#)|(?<=\bTIME#))[0-9])[^\n]*|'[^'\n]*')"  # 11 comment or string elsewhere
    rf"|([&|{_OPERATOR_SIGNS}])"  # 12 an operator in disguise
    rf"|({_GARBAGE}+(?:[ \t\r\n]+{_GARBAGE}+)*|[\s\S])"  # 13 garbage, a run in one
    r")"
)

_INVISIBLE = {
    "\u00a0": "a no-break space",
    "\u200b": "a zero-width space",
    "\ufeff": "a byte-order mark",
    "\x00": "a NUL byte",
    "\x0b": "a vertical tab",
    "\x0c": "a form feed",
    "\ufffd": "a byte that is not UTF-8",
}

_ESCAPES = {'"': '"', "\\": "\\", "n": "\n", "t": "\t"}
_ESCAPE = re.compile(r"\\(.)")
_BAD_ESCAPE = re.compile(r'\\(?!["\\nt]).|\\\\|\\["nt]')


@dataclass(slots=True)
class Tokens:
    """The tokens of one file as parallel lists, with some tokens of kind `EOF` at the end.

    `kinds[i]` is the text itself for punctuation and reserved words, else one of the kinds above.
    `comments` are `(start, end)` offsets in order. `bad` has the indices of tokens with an error
    that was already reported, `lost` the names that lines of other languages declare. `truncated`:
    the rest of the file was not read, so the end of the tokens is no error.
    """

    source: Source
    kinds: list[str] = field(default_factory=list)
    texts: list[str] = field(default_factory=list)
    starts: list[int] = field(default_factory=list)
    ends: list[int] = field(default_factory=list)
    comments: list[tuple[int, int]] = field(default_factory=list)
    bad: set[int] = field(default_factory=set)
    problems: list[Diagnostic] = field(default_factory=list)
    truncated: bool = False
    lost: set[str] = field(default_factory=set)

    def append_token(self, kind: str, text: str, start: int, end: int) -> None:
        """Appends a token."""
        self.kinds.append(kind)
        self.texts.append(text)
        self.starts.append(start)
        self.ends.append(end)

    def report(
        self,
        code: Code,
        message: str,
        start: int,
        end: int,
        label: str = "",
        *,
        notes: tuple[str, ...] = (),
        helps: tuple[Help, ...] = (),
    ) -> None:
        """Adds a lexical error to `problems`; the parser then ignores errors at the next token."""
        primary = Label(Span(self.source, start, end), label)
        self.problems.append(make_diagnostic(code, message, primary, (), notes, helps))
        self.bad.add(len(self.kinds))


def lex(source: Source) -> Tokens:
    """Gives all tokens of `source`; problems are in the result, nothing is raised."""
    tokens = Tokens(source)
    kinds, texts, starts, ends = tokens.kinds, tokens.texts, tokens.starts, tokens.ends
    kind_of_word = _KIND_OF_WORD.get
    text = source.text
    begin = 1 if text.startswith("\ufeff") else 0
    for match in _TOKEN.finditer(text, begin):
        group = match.lastindex
        token: str = match[group]  # type: ignore[index]
        end = match.end()
        if group == 1:
            kinds.append(kind_of_word(token, NAME))
        elif group == 2:
            kinds.append(token)
        elif group == 3:
            if token[-1] in "snh":
                kinds.append(DURATION)
            else:
                kinds.append(FLOAT if "." in token or "e" in token or "E" in token else INT)
        elif group == 4:
            tokens.comments.append((end - len(token), end))
            continue
        elif group == 5:
            if "\\" in token:
                _report_unknown_escape(tokens, token, end - len(token))
            kinds.append(STRING)
        elif group == 6:
            break
        else:
            _REPORT_OF_GROUP[group](tokens, token, end - len(token), end)  # type: ignore[index]
            if len(tokens.problems) >= _ERRORS_MAX:
                tokens.truncated = True
                break
            continue
        texts.append(token)
        starts.append(end - len(token))
        ends.append(end)
    for _ in range(1 + _LOOK_AHEAD):
        tokens.append_token(EOF, "", len(text), len(text))
    if PUSH in kinds:
        _turn_push_into_name(kinds)
    if not SOFT.isdisjoint(kinds):
        _turn_soft_words_into_names(kinds)
    return tokens


def _turn_soft_words_into_names(kinds: list[str]) -> None:
    """Turns reserved words into names where their neighbours show it: `next` in `m.next`.

    Such a word is a name after a token that a name follows, and before `=`, `:`, an operator or a
    closing bracket.
    """
    for i, kind in enumerate(kinds):
        if kind in SOFT and (kinds[i + 1] in _NAME_BEFORE or (i and kinds[i - 1] in _NAME_FOLLOWS)):
            kinds[i] = NAME


def _turn_push_into_name(kinds: list[str]) -> None:
    """Turns `push` into a name, except where a statement `push list, value;` can begin."""
    for i, kind in enumerate(kinds):
        if kind == PUSH and not (i and kinds[i - 1] in ("{", "}", ";") and kinds[i + 1] == NAME):
            kinds[i] = NAME


def string_value(text: str) -> str:
    """Gives the characters of a string token; unknown escapes keep their backslash."""
    body = text[1:-1] if len(text) > 1 and text.endswith('"') else text[1:]
    if "\\" not in body:
        return body
    return _ESCAPE.sub(lambda m: _ESCAPES.get(m[1], m[0]), body)


def printable(text: str, limit: int = 24) -> str:
    """Gives a text to quote in a message: printable, on one line, cut after `limit` characters."""
    shown = "".join(c if c.isprintable() else _code_point_text(c) for c in text[:limit])
    return shown + "..." if len(text) > limit else shown


def _code_point_text(char: str) -> str:
    return f"<U+{ord(char):04X}>"


def _report_unknown_escape(tokens: Tokens, token: str, start: int) -> None:
    for match in _BAD_ESCAPE.finditer(token):
        if match[0][1:] not in _ESCAPES:
            tokens.report(
                "L007",
                f"unknown escape `{printable(match[0])}` in a string",
                start + match.start(),
                start + match.end(),
                helps=('the escapes are `\\"`, `\\\\`, `\\n` and `\\t`',),
            )
            return


def _report_non_ascii_name(tokens: Tokens, token: str, start: int, end: int) -> None:
    wide = next(c for c in token if not c.isascii())
    at = start + token.index(wide)
    tokens.report(
        "L008",
        f"`{printable(token)}` is not a name",
        start,
        end,
        f"`{printable(wide)}` ({_code_point_text(wide)[1:-1]}) at column "
        f"{tokens.source.column_of(at)} is not an ASCII letter",
        notes=("names are made of the letters a-z and A-Z, digits and `_`: they become C names",),
    )
    tokens.append_token(NAME, token, start, end)


def _report_malformed_number(tokens: Tokens, token: str, start: int, end: int) -> None:
    code: Code = "L004"
    message, label = f"malformed number `{printable(token)}`", ""
    helps: tuple[Help, ...] = ()
    notes: tuple[str, ...] = ()
    span = Span(tokens.source, start, end)
    number = re.match(r"([0-9][0-9_]*(?:\.[0-9_]+)?(?:[eE][+-]?[0-9]+)?)(.*)", token, re.DOTALL)
    if re.fullmatch(r"\.[0-9]+(?:[eE][+-]?[0-9]+)?(?:ns|us|ms|s|min|h)?", token):
        label, helps = "a digit must stand before the point", (replace(span, f"0{token}"),)
    elif match := re.fullmatch(r"([0-9]+)\.((?:[eE][+-]?[0-9]+)?(?:ns|us|ms|s|min|h)?)", token):
        label, helps = (
            "a digit must stand after the point",
            (replace(span, f"{match[1]}.0{match[2]}"),),
        )
    elif re.match(r"0[xXbBoO]", token):
        label, helps = "numbers are decimal", _decimal_help(token, span)
    elif number and re.fullmatch(r"[^\W\d_]+", number[2]) and "__" not in number[1]:
        code, message = "L006", f"`{printable(number[2])}` is not a unit of time"
        label = "units are ns, us, ms, s, min and h"
        help_ = _unit_help(number[1], number[2], span)
        helps = () if help_ is None else (help_,)
        notes = () if helps else ("a quantity other than a time carries no unit: it is in SI",)
    elif suffixed := re.fullmatch(r"([0-9][0-9_.]*?)_?([fiu](?:8|16|32|64|size)|[uUlL]+)", token):
        label, helps = "numbers have no suffix", (replace(span, suffixed[1]),)
    elif "_" in token:
        label = "`_` may only stand between two digits"
    elif token.count(".") > 1:
        label = "more than one point"
    else:
        label = "a name cannot start with a digit"
    tokens.report(code, message, start, end, label, notes=notes, helps=helps)
    tokens.append_token(ERROR, token, start, end)


def _decimal_help(token: str, span: Span) -> tuple[Help, ...]:
    try:
        return (replace(span, f"{int(token[:40], 0)}"),)
    except ValueError:
        return ()


def period_text(rate: float) -> str:
    """Gives the period of a rate in Hz as source text: `10ms`."""
    if not 1e-3 < rate < 1e9:
        return "10ms"
    period_ms = 1e3 / rate
    return f"{period_ms:g}ms" if period_ms >= 1.0 else f"{round(period_ms * 1e6)}ns"


def _unit_help(number: str, unit: str, span: Span) -> Help | None:
    """Gives the help for a number with a wrong unit or suffix; None if there is none."""
    if unit.lower() == "hz":
        period = period_text(float(number.replace("_", "")))
        return replace(span, period, f"a period is a time: `{period}`")
    if unit in ("f", "F", "d", "L", "l", "u", "U"):
        plain = f"{number}.0" if unit in "fFd" and number.isdigit() else number
        return replace(span, plain, f"numbers have no suffix: write `{plain}`")
    if THEIRS.get(unit) in UNIT_NS:
        return replace(span, f"{number}{THEIRS[unit]}")
    return None


def _report_open_string(tokens: Tokens, token: str, start: int, end: int) -> None:
    body = token.rstrip()
    body = body[:-1] if body.endswith(";") and len(body) > 1 else body
    tokens.report(
        "L003",
        "this string has no end",
        start,
        start + len(body),
        "starts here and runs to the end of the line",
        helps=('close it with `"` on the same line',),
    )
    tokens.append_token(STRING, body, start, start + len(body))
    tokens.bad.add(len(tokens.kinds))
    if body != token.rstrip():
        tokens.append_token(";", ";", start + len(body), start + len(body) + 1)
        tokens.bad.add(len(tokens.kinds))
    del end


def _report_open_comment(tokens: Tokens, token: str, start: int, end: int) -> None:
    del token, end
    tokens.report(
        "L002",
        "this comment has no end",
        start,
        start + 2,
        "starts here",
        helps=("close it with `*/`; comments do not nest",),
    )
    tokens.truncated = True


def _report_foreign_text(tokens: Tokens, token: str, start: int, end: int) -> None:
    span = Span(tokens.source, start, end)
    if token[0] == "#":
        line = explain_hash_line(tokens.source, token.rstrip(), start)
        tokens.lost |= line.declares
        tokens.report("L001", line.message, line.span.start, line.span.end, helps=line.helps)
        return
    helps: tuple[Help, ...] = (replace(span, f'"{printable(token[1:-1], 200)}"'),)
    message = "strings are written with double quotes"
    if not (tokens.kinds and tokens.kinds[-1] in (NAME, "import", ",")):  # where strings follow
        message = "there are no characters and no texts at run time"
        helps = ("name the cases, `type Name = enum { A, B };`, or write a number",)
    tokens.report("L001", message, start, end, helps=helps)
    tokens.append_token(STRING, token, start, end)
    tokens.bad.add(len(tokens.kinds))


def _report_operator_lookalike(tokens: Tokens, token: str, start: int, end: int) -> None:
    operand = tokens.kinds and tokens.kinds[-1] in ("(", ",", "=")
    if operand and token.startswith("&"):
        _report_unknown_characters(tokens, token, start, end)
        return
    meant = token * 2 if token in ("&", "|") else token
    point = "" if token.isascii() else f" ({_code_point_text(token)[1:-1]})"
    message = f"`{token}`{point} is not an operator of Soter"
    span = Span(tokens.source, start, end)
    helps = () if meant == token else (replace(span, meant),)
    tokens.report("L001", message, start, end, helps=helps)
    tokens.append_token(meant, meant, start, end)


def _report_unknown_characters(tokens: Tokens, token: str, start: int, end: int) -> None:
    if len(token) == 1:
        name = _INVISIBLE.get(token, f"`{printable(token)}`")
        message = f"unexpected {name}" if token in _INVISIBLE else f"unexpected character {name}"
    else:
        message = f"unexpected characters `{printable(token)}`"
    label = "no token of Soter begins like this"
    word = "" if token[0] in "&|" else foreign_word_at(tokens.source.text, start)
    helps = helps_for_word(word, Span(tokens.source, start, start + len(word)))
    tokens.report("L001", message, start, end, label, helps=helps)


_REPORT_OF_GROUP = {
    7: _report_non_ascii_name,
    8: _report_malformed_number,
    9: _report_open_string,
    10: _report_open_comment,
    11: _report_foreign_text,
    12: _report_operator_lookalike,
    13: _report_unknown_characters,
}
