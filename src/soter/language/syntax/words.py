"""Explains misplaced words of Soter, and words of other languages, by the tables of `words.toml`.

Purpose: the tables are read at the first mistake and never for a correct program. For a word of
Soter in a wrong place (in another body, after another item, or too late in its own) they say where
it belongs; for a word of another language, what Soter has instead, also for types with a range,
quantities with a unit and rates. Parser and checker ask here about unknown words.
Non-goals: phrases (`foreign_phrases.py`); how the parser goes on (`parsing/token_cursor.py`).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable


_FOLDER = Path(__file__).parent


def toml_of(text: str) -> dict[str, Any]:
    """The content of a text in TOML, for which Python 3.10 has no reader of its own."""
    toml = import_module("tomllib" if find_spec("tomllib") else "tomli")
    read: dict[str, Any] = toml.loads(text)
    return read


@cache
def word_table(name: str) -> dict[str, Any]:
    """The table of this name, in the order of its file."""
    return toml_of((_FOLDER / f"{name}.toml").read_text(encoding="utf-8"))


def meaning(sort: str, word: str, body: str = "") -> str | None:
    """The entry of a table of `words.toml` for a word, in this body if the table has bodies."""
    return _meanings(sort, body).get(word)


@cache
def _meanings(sort: str, body: str) -> dict[str, str]:
    table = word_table("words")[sort]
    tables = [rows for bodies, rows in table.items() if body in bodies.split()] if body else [table]
    pairs = [
        (said, words) if isinstance(words, str) else words
        for rows in tables
        for said, words in rows.items()
    ]
    return {word: said for said, words in pairs for word in words.split()}


NODE, STEP, RTA, VERIFY, PLANT = "node", "step", "rta", "verify", "plant"
SYSTEM, TEST, FAULTS, FUNCTION, TOP = "system", "test", "faults", "function", "top"


@dataclass(frozen=True)
class Home:
    """Where a word belongs, as a phrase, and the item that it stands in there."""

    where: str
    form: str


_TABLE_LINE = re.compile(r"(\w+): (.*)")
"""Matches a line of the table that begins with another word than the one it explains."""


@cache
def places() -> dict[str, tuple[Home, ...]]:
    """For each word of an item or clause, the places where it belongs."""
    homes: dict[str, tuple[Home, ...]] = {}
    for where, forms in word_table("words")["place"].items():
        for line in map(str.strip, forms.split("\n")):
            led = _TABLE_LINE.fullmatch(line)
            word, form = led.groups() if led else (line.split()[0].rstrip(";"), line)
            homes[word] = (*homes.get(word, ()), Home(where, form))
    return homes


_VERIFY_BLOCK = "in the `verify` block of an `rta`"
#: Bodies by an item that only they have.
_BODY_BY_ITEM = (
    ("subscribes", NODE),
    ("der", PLANT),
    ("ac", RTA),
    ("until", SYSTEM),
    ("quantum", TEST),
    ("grid", VERIFY),
    ("bias", FAULTS),
)

_CLAUSE = re.compile(r"\s*[\w\"{(!\[-]")
"""Matches the text after a word of an item or clause; after a name follow `=`, `.` or `;`."""
_TIMES = re.compile(r"\s*\[[^\];]*,[^\];]*\]\s*;")
_RANGE = re.compile(r"\s*[\[{]")
_VALUES = (r'"[^"]*"', r"\[[^\]]*\]", r"\d[\d._]*(?:[num]?s|min|h)\b", r"-?\d[\d._]*\b")
"""Kinds of values: a text, a range, a time, a number."""
_SHOWN_MAX = 80
"""Most characters of an item that a message shows."""


@dataclass(frozen=True)
class Misplaced:
    """The message about a word in a wrong place."""

    message: str
    note: str
    help: str


def body_of(items: Collection[str], blocks: int) -> str:
    """The kind of the present body, by the words that begin its items and the blocks around."""
    for word, kind in _BODY_BY_ITEM:
        if word in items:
            return STEP if kind == NODE and blocks else kind
    return FUNCTION if blocks else TOP


def is_clause(word: str, rest: str) -> bool:
    """Whether `word` is one of an item or clause, by the text behind it."""
    if word == "in":
        return _RANGE.match(rest) is not None
    if word == "takes":
        return _TIMES.match(rest) is not None
    if word in ("induction", "static"):
        return rest.lstrip()[:1] == ";"
    if word == "on":
        return rest.split(None, 1)[:1] == ["takeover"]
    return _CLAUSE.match(rest) is not None and word in places()


def _in_its_block(home: Home, form: str) -> str:
    """An item as it is written, with the block that is often forgotten around it."""
    return f"verify {{ {form} }}" if home.where == _VERIFY_BLOCK else form


def misplaced(word: str, body: str, item: str, written: str) -> Misplaced | None:
    """The message about a word in this body, after the item that `item` leads; None if unknown.

    `written` is the item that the word begins, as far as its `;` or a brace.
    """
    shown = "on takeover" if word == "on" else word
    where = f"behind `{item}`" if item else meaning("here", body)
    message = f"`{shown}` does not belong {where}"
    if word == "in":
        said = next((r for r in word_table("words")["range"] if item in r["behind"].split()), None)
        text = f"{message}: no range stands here"
        if said is None:
            return None
        return Misplaced(text, said["note"], _as_written(said["help"], word, written))
    homes = places()[word]
    if word == "within":
        homes = homes[1:] if body in (SYSTEM, TEST) else homes[:1]
    belongs = " or ".join(home.where for home in homes)
    note = f"`{shown}` belongs {belongs}"
    advice = meaning("misplaced", word, body)
    line = "" if item else " ".join(written.split())
    if advice is None:
        advice = f"move it there: {' or '.join(_shown_forms(word, homes, line))}"
    elif _is_whole(line):
        advice = re.sub(rf"`{word} [^`]*`", lambda _: f"`{line}`", advice)
    return Misplaced(message, note, _as_written(advice, word, written))


def _as_written(advice: str, word: str, written: str) -> str:
    """Advice that has the value written behind a word, in place of one of its kind."""
    for kind in _VALUES:
        value = re.match(rf"{word}\s+({kind})", written)
        if value is not None:
            return re.sub(rf"(?<=\b{word} ){kind}", value[1].replace("\\", r"\\"), advice)
    return advice


def _is_whole(line: str) -> bool:
    """Whether a line is an item as far as its `;`, and short enough to be shown."""
    return line.endswith(";") and len(line) < _SHOWN_MAX


def _shown_forms(word: str, homes: Iterable[Home], line: str) -> list[str]:
    """What a word looks like where it belongs, in backticks: the line as it is, if it is whole."""
    if line.endswith("}") and "{" not in line:  # its `;` is missing
        line = f"{line[:-1].rstrip()};"
    forms = [
        _in_its_block(
            home, line if _is_whole(line) and home.form.startswith(f"{word} ") else home.form
        )
        for home in homes
    ]
    return [f"`{form}`" for form in dict.fromkeys(forms)]


_SIZED = re.compile(r"(u?)(?:int|i)(8|16|32)(?:_t)?|u(8|16|32)")

LIBRARIES = frozenset(
    ["math", "np", "numpy", "cmath", "std", "Math", "torch", "jnp", "jax", "scipy", "tf", "libm"]
)
"""Names of libraries whose functions the prelude replaces."""


def type_meant(word: str) -> str | None:
    """The type of Soter for a type of another language: `int in [0, 255]` for `uint8_t`."""
    small = word.lower()
    match = _SIZED.fullmatch(small)
    if match is None:
        return meaning("type", small)
    bits = int(match[2] or match[3])
    unsigned = bool(match[1]) or match[3] is not None
    low, high = (0, 2**bits - 1) if unsigned else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    return f"int in [{low}, {high}]"


def type_advice(word: str) -> str | None:
    """Advice for a type of another language that Soter has no counterpart for."""
    return meaning("no_text", word.lower()) or meaning("no_type", word)


def in_si(number: str, unit: str) -> str | None:
    """A quantity with a unit as the bare number of SI that it stands for."""
    scale = meaning("unit", unit)
    if scale is None or scale == "1.0":
        return scale and number
    return repr(float(f"{float(number.replace('_', '')) * float(scale):.12g}"))


def period_of(rate: str) -> str | None:
    """The period of a rate in Hz where it is a whole number of nanoseconds: `20ms` for `50`."""
    value = float(rate.replace("_", ""))
    if not 1e-3 < value <= 1e9:
        return None
    period_ns = round(1e9 / value)
    if abs(period_ns * value - 1e9) > 1e-3:
        return None
    for unit, size in (("s", 1_000_000_000), ("ms", 1_000_000), ("us", 1_000)):
        if period_ns % size == 0:
            return f"{period_ns // size}{unit}"
    return f"{period_ns}ns"
