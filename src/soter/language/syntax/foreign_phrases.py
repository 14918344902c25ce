"""Recognizes a phrase of another language where the parser cannot go on.

Purpose: `find` says whether the text there is a phrase of C, C++, Python, Rust, ROS or a textbook,
and which edit turns it into Soter. The phrases are tables in `phrases/`, in the order in which they
are tried; the functions that they name are here. They are read at the first error, and a phrase
counts only if it covers the error.
Non-goals: single words (`words.py`); how parsing goes on (`parsing/token_cursor.py`).

The header of a row is the message. `find` is its pattern, whose lines are joined; in it `<name>` is
a group of one word, `<NAME>` one of `FRAGMENTS`, and the group `at` is where the message points,
without it the whole match. `write` is Soter with gaps for the groups: `<a,b>` is the first that is
there, `<a|change>` one that a function here changes; where gaps do not do, `by` names the one that
writes the whole match, or None. `advise` is the help without an edit, or its title. `places` are
the bodies in which it counts; `far`: over several lines; `only_shown`: the edit is not offered.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache, cached_property
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Edit, Fix, Span
from soter.language.syntax.words import LIBRARIES, meaning, places, type_meant, word_table

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping

    from soter.diagnostics.diagnostic import Help, Source


_FIELDS_MAX = 60
TYPE = r"(?:unsigned\s+|long\s+)?[A-Za-z_]\w*"
_NO_TYPES = frozenset(
    ["return", "publish", "let", "var", "push", "else", "in", "void", "fun", "node", "rta", "plant",
     "system", "test", "topic", "const", "param", "if", "for", "while", "step", "extern"]
)  # fmt: skip
_BETWEEN = frozenset(
    ["in", "as", "to", "and", "or", "if", "else", "at", "by", "for", "per", "mod", "is", "not",
     "open", "init", "with", "implies", "between"]
)  # fmt: skip
_NAMED_ARGUMENT = r"\b(\w+)\s*=(?!=)\s*"
_PARAMETER = re.compile(
    r"\s*(?:const\s+)?([A-Za-z_]\w*)\s*[&*]?\s*\b([A-Za-z_]\w*)\s*(\[\s*\w+\s*\])?\s*"
)
_ENUM = re.compile(r"^type\s+(\w+)\s*=\s*enum\s*\{([^{}]*)\}", re.MULTILINE)


# ---------------------------------------------------------------- changes of the text of a group


def soter_type(word: str) -> str:
    """The Soter type for a type of another language; the word itself if there is none."""
    return type_meant(" ".join(word.split()[-1:])) or word


def type_of(value: str) -> str | None:
    """The type that a literal value shows; None if it shows none."""
    value = value.strip()
    if value in ("true", "false"):
        return "bool"
    if re.fullmatch(r"-?\d+", value):
        return "int"
    is_sum = re.fullmatch(r"[\d.eE+*/() A-Z_a-z-]+", value) and re.search(r"\d", value)
    return "float" if is_sum else None


def next_number(text: str) -> str:
    """The text for one more: `4` for `3`, `n + 1` for `n`."""
    return str(int(text) + 1) if text.isdigit() and len(text) < 20 else f"{text} + 1"


def parameters(text: str) -> str | None:
    """Writes `Motion m, float xs[4]` as `m: Motion, xs: float[4]`; None for any other text."""
    params: list[str] = []
    for part in text.split(",") if text.strip() else []:
        match = _PARAMETER.fullmatch(part)
        if match is not None and match[1] != "const":
            params.append(f"{match[2]}: {soter_type(match[1])}{match[3] or ''}")
        elif pair := re.fullmatch(r"\s*(?:const\s+)?(\w+\s*:\s*[\w.]+(?:\[\w+\])?)\s*", part):
            params.append(pair[1])
        else:
            return None
    return ", ".join(params)


def fields(text: str) -> str | None:
    """`float x; float v;` or `x: float, v: float` as the fields of a record type."""
    field_list: list[str] = []
    for part in re.split(r"[;,\n]", text):
        if not part.strip():
            continue
        pair = re.fullmatch(r"\s*(?:pub\s+)?(\w+)\s*:\s*([\w.\[\]]+)\s*", part)
        typed = re.fullmatch(rf"\s*({TYPE})\s+(\w+)\s*(\[\w+\])?\s*", part)
        if pair:
            field_list.append(f"{pair[1]}: {type_meant(pair[2]) or pair[2]}")
        elif typed:
            field_list.append(f"{typed[2]}: {soter_type(typed[1])}{typed[3] or ''}")
        else:
            return None
    return ", ".join(field_list) or None


def members(text: str) -> str | None:
    """The names between the braces of an enum; None where one has a number."""
    names = [m.strip() for m in text.split(",") if m.strip()]
    return ", ".join(names) if names and all(re.fullmatch(r"\w+", m) for m in names) else None


def factor(text: str) -> str:
    """A value as an operand: in parentheses unless it is a simple one."""
    value = text.strip()
    return value if re.fullmatch(r"[\w.]+(?:\[\w+\])*(?:\([\w., ]*\))?", value) else f"({value})"


def prelude(word: str) -> str:
    """The prelude's name for a function of another language; the word itself if it has none."""
    return meaning("function", word) or word


# ---------------------------------------------------------------- writers of a match


def named_constant(match: re.Match[str]) -> str:
    """`const float A` and `const A float` as `const A: float`."""
    name, of = match["name"], match["type"]
    if type_meant(name) and not type_meant(of):
        name, of = of, name  # `const A float`
    return f"const {name}: {soter_type(of)}"


def list_of_parameters(match: re.Match[str]) -> str | None:
    """`(float x)` as `(x: float)`."""
    params = parameters(match["parameters"])
    unchanged = params is None or params == match["parameters"].strip()
    return None if unchanged else f"({params})"


def loop(match: re.Match[str]) -> str | None:
    """The head of a loop in three parts as one over a range."""
    high = match["high"].strip()
    end = next_number(high) if match["sign"] == "<=" else high
    return f"for {match['i']} in {match['low'].strip()}..{end} "


def scoped(match: re.Match[str]) -> str | None:
    """`std::abs` as `abs`, `a->b` and `a::b` as `a.b`."""
    head, name = match["head"], match["name"]
    if head in LIBRARIES or head == "this":
        return prelude(name)
    return f"{head}.{name}"


def comprehension(match: re.Match[str]) -> str | None:
    """`[0.0 for i in range(2)]` as `[0.0, 0.0]`."""
    count = int(match["count"])
    return None if not 1 <= count <= 16 else f"[{', '.join([match['value']] * count)}]"


def rewired(match: re.Match[str]) -> str | None:
    """Wires with `=` for `:=`."""
    return match[0].replace(":=", "=")


def designated(match: re.Match[str]) -> str | None:
    """`.x = e` as `x: e`."""
    return re.sub(r"\.\s*(\w+)\s*=\s*", r"\1: ", match[0])


def power(match: re.Match[str]) -> str | None:
    """`x ** 2` as `(x * x)`."""
    return f"({' * '.join([match['base']] * int(match['power']))})"


def together(match: re.Match[str]) -> str | None:
    """The loop that a comprehension or a generator stands for."""
    x, xs = match["x"], match["xs"]
    if re.match(r"\[\s*-?[\d.]+\s+for\b", match["at"]):
        return None  # `comprehension` writes the elements
    if xs == "range":
        return f"a loop stands before it: `for {x} in 0..4 {{ ... }}`"
    if match["at"][0] == "[":
        return f"before it stand `var ys: float[<=8];` and `for {x} in {xs} {{ push ys, ...; }}`"
    name, start = {
        "sum": ("sum", "0.0"), "any": ("found", "false"), "all": ("all", "true")
    }.get(match["fun"] or "", ("best", f"{xs}[0]"))  # fmt: skip
    return f"before it stand `var {name} = {start};` and `for {x} in {xs} {{ {name} = ...; }}`"


def unpacked(match: re.Match[str]) -> str | None:
    """`let (a, b) = e` as one `let` for each name, which take the parts of a pair or a field."""
    names = [n.strip() for n in match["names"].split(",")]
    what = match["what"].strip()
    inner = what[1:-1] if what[:1] + what[-1:] in ("()", "[]") else what
    parts = [p.strip() for p in inner.split(",")] if "(" not in inner else [what]
    word = match["word"] if match["word"] in ("let", "var") else "let" if match["word"] else ""
    if len(parts) != len(names):
        if len(parts) > 1 or not re.fullmatch(r"[\w.]+(\([^()]*\))?", what):
            return None
        fields = "xyzw" if len(names) <= 4 else ""
        parts = [f"{what}.{f}" for f, _ in zip(fields, names, strict=False)]
    elif not word and set(names) & set(re.findall(r"\w+", " ".join(parts[1:]))):
        return None  # each would see what was assigned before
    return "; ".join(f"{word} {n} = {p}".strip() for n, p in zip(names, parts, strict=False))


def one_by_one(match: re.Match[str]) -> str | None:
    """`var a, b: float` as `var a: float; var b: float`."""
    names = [n.strip() for n in match["names"].split(",")]
    return "; ".join(f"{match['word']} {n}{match['rest']}" for n in names)


def part_of_a_list(match: re.Match[str]) -> str | None:
    """The loop over the part that a slice names."""
    xs, low, high = match["xs"], match["low"] or "0", match["high"]
    if low.startswith("-") or high.startswith("-") or not high:
        high = "4"
        low = "0" if low.startswith("-") else low
    return f"count over its part, `for i in {low}..{high} {{ ... }}`, and read `{xs}[i]`"


def _rows(text: str) -> list[list[str]] | None:
    """The elements of `1 0; 0 1`, and of `0.0; 2`, which is a number and how often it stands."""
    rows = [re.split(r"\s*,\s*|[ \t]+", row.strip()) for row in text.split(";")]
    if len({len(row) for row in rows}) > 1 or not re.match(r"-?[\d.]", rows[0][0]):
        return None
    repeated = len(rows) == 2 and len(rows[0]) == 1 and re.fullmatch(r"[2-9]|1[0-6]", rows[1][0])
    return rows[:1] * int(rows[1][0]) if repeated else rows


def matrix(match: re.Match[str]) -> str | None:
    """`[1 0; 0 1]` as `[[1.0, 0.0], [0.0, 1.0]]`, `[1 2]` as `[1.0, 2.0]`, `[0.0; 2]` in full.

    Whole numbers become floats unless the line speaks of an int; a factor is no array.
    """
    line = match.string[match.string.rfind("\n", 0, match.start()) + 1 : match.start()]
    around = line.rstrip()[-1:] + match.string[match.end() :].lstrip()[:1]
    rows = _rows(match["rows"])
    if rows is None or "*" in around:
        return None
    if not re.search(r"\bint\b", line):
        rows = [[f"{e}.0" if re.fullmatch(r"-?\d+", e) else e for e in row] for row in rows]
    if len(rows) == 1 or len(rows[0]) == 1:
        return f"[{', '.join(e for row in rows for e in row)}]"
    arrays = [f"[{', '.join(row)}]" for row in rows]
    return f"[{', '.join(arrays)}]"


def member(match: re.Match[str]) -> str | None:
    """`"Drive"` as `Phase.Drive` where a type of the file has that case, `"SC"` as `Mode.SC`."""
    wanted = match["member"].lower()
    if wanted in ("ac", "sc"):
        return f"Mode.{wanted.upper()}"
    for name, members in _ENUM.findall(match.string):
        for one in re.findall(r"\w+", members):
            if one.lower() == wanted:
                return f"{name}.{one}"
    return None


def function_of(match: re.Match[str]) -> str:
    """`inside = lambda p: e` as the head of `fun inside(p: ...): bool { ... }`."""
    groups = [g for g in ("a", "b", "c", "d", "e", "ps") if g in match.re.groupindex]
    names = next((match[g] for g in groups if match[g] is not None), "")
    params = [n.split()[-1] for n in names.split(",") if n.strip()]
    result = "bool" if re.search(r"[<>!=]=?|&&|\|\||\band\b|\bor\b", match["what"]) else "float"
    listed = ", ".join(f"{n}: ..." for n in params)
    what = match["what"].strip("; }")
    shown = what if what and len(what) < _FIELDS_MAX else "..."
    return f"fun {match['name']}({listed}): {result} {{ return {shown}; }}"


def function_beside(match: re.Match[str]) -> str:
    """The head of a function for what stands in a step, and where to put it."""
    return f"declare it beside the nodes: `{function_of(match)}`"


def one_of(match: re.Match[str]) -> str | None:
    """`x in (A, B)` as `x == A || x == B`."""
    values = [v.strip() for v in match["values"].split(",")]
    sign, joint = ("!=", " && ") if match["at"].startswith("not") else ("==", " || ")
    return f"({joint.join(' '.join((match['x'], sign, v)) for v in values)})"


def two_by_two(match: re.Match[str]) -> str | None:
    """`min({a, b, c})` as `min(a, min(b, c))`."""
    *rest, whole = [v.strip() for v in match["values"].split(",")]
    for value in reversed(rest):
        whole = f"{match['fun']}({value}, {whole})"
    return whole if rest else None


def slope_of_a_state(match: re.Match[str]) -> str | None:
    """`x_dot = e` and `dx = e` as `der x = e`, where the file has that state."""
    name = match["name"] or match["other"] or match["third"]
    declared = re.search(rf"\bstate\s+{name}\b", match.string)
    return f"der {name} = {match['what']}" if declared else None


def after_a_period(match: re.Match[str]) -> str | None:
    """`x[k+1] = x[k] + v` as `next x = x + v`."""
    name = match["name"]
    value = re.sub(rf"\b({name})\s*[\[(]\s*\w+\s*[\])]", r"\1", match["what"])
    return f"next {name} = {value}"


def product(match: re.Match[str]) -> str | None:
    """`2 x` as `2 * x`, unless the word is one of the language or a unit of time."""
    word = match["x"]
    unit = re.fullmatch(r"(?:[num]?s|min|h|hz|Hz|sec\w*|m|deg|rad)", word)
    return None if unit or word in _BETWEEN or word in places() else f"{match['n']} * {word}"


CHANGES: Mapping[str, Callable[[str], str | None]] = {
    "strip": str.strip,
    "lower": str.lower,
    "there": lambda text: text or None,
    "soter_type": soter_type,
    "result_type": lambda word: None if word in _NO_TYPES else soter_type(word),
    "number": lambda word: of if (of := type_meant(word)) in ("float", "int") else None,
    "type_of": type_of,
    "prelude": prelude,
    "next": next_number,
    "hundredth": lambda text: f"{float(text) / 100:.12g}",
    "factor": factor,
    "parameters": parameters,
    "fields": fields,
    "members": members,
    "names": lambda text: ", ".join(re.findall(r"[A-Za-z_]\w*", text)),
    "separated": lambda text: ", ".join(re.split(r"\s*(?:,|\||\bor\b)\s*", text)),
    "unnumbered": lambda text: re.sub(r"\s*=\s*\w+", "", text),
    "colons": lambda text: re.sub(_NAMED_ARGUMENT, r"\1: ", text).strip(),
    "unnamed": lambda text: re.sub(_NAMED_ARGUMENT, "", text),
}
"""Changes of a group's text: `A = 0` loses its number, `x=1.0` gets a colon or no name."""
WRITERS: Mapping[str, Callable[[re.Match[str]], str | None]] = {
    writer.__name__: writer
    for writer in (
        after_a_period, comprehension, designated, function_beside, function_of,
        list_of_parameters, loop, matrix, member, named_constant, one_by_one, one_of,
        part_of_a_list, power, product, rewired, scoped, slope_of_a_state, together, two_by_two,
        unpacked,
    )
}  # fmt: skip


NODE, PLANT, MODULE, FUNCTION, TOP = "node", "plant", "module", "function", "top"

_TABLES = ("declarations", "expressions", "habits")
FRAGMENTS = {
    "STATEMENT": r"(?:^|(?<=[;{}]))[ \t]*",
    "ARGUMENTS": r"(?:[^;()\n]|\((?:[^;()\n]|\([^;()\n]*\))*\))*",
    "BRACKETS": r"\((?:[^()]|\([^()]*\))*\)",
    "CONDITION": r"\b(?P<word>safe|ttf|safer|always|never|assumes|guarantees|assert)\s+",
    "CONTAINER": r"(?:std::)?(?:vector|array|deque|list|List|Vec|Array|Sequence)",
    "EXPRESSION": r"[^;{}=\n]+?",
    "LIBRARIES": "|".join(sorted(LIBRARIES)),
    "LIST": r"(?P<list>[A-Za-z_][\w.]*(?:\[\w+\])*)",
    "NAMES": r"\w+(?:\s*,\s*\w+)+",
    "TYPE": TYPE,
    "TYPED": r"(?P<name>[A-Za-z_]\w*)\s*:\s*(?P<type>(?:float|int|bool|duration)(?:\[\w+\])?)",
}
_SHORT_GAP = re.compile(r"(?<!P)<(\w+)>")
_GAP = re.compile(r"<([\w,]+)(?:\|(\w+))?>")
_DIVISION = re.compile(r"[ \t]*(//)[ \t]*[\w.(-][\w.()+* -]*[])};][^\n]*")
_PHRASE_MAX = 400
"""Most characters that are searched for a phrase over several lines."""
_SHOWN_MAX = 200
"""Most characters of an edit that a message shows; an editor inserts all of them."""


@dataclass(frozen=True)
class Form:
    """A row of the tables, for one phrase."""

    message: str
    find: str
    write: str | None = None
    by: str = ""
    advise: str = ""
    places: str = ""
    far: bool = False
    only_shown: bool = False

    @cached_property
    def pattern(self) -> re.Pattern[str]:
        """The row's pattern with its fragments filled in."""
        text = "".join(line.lstrip() for line in self.find.split("\n"))
        text = _SHORT_GAP.sub(lambda m: FRAGMENTS.get(m[1]) or rf"(?P<{m[1]}>\w+)", text)
        return re.compile(text, re.MULTILINE | (re.DOTALL if self.far else 0))

    def soter(self, match: re.Match[str]) -> str | None:
        """The Soter text for a match; None if it is no such phrase after all."""
        return WRITERS[self.by](match) if self.by else filled(self.write or "", match)


def filled(form: str, match: re.Match[str]) -> str | None:
    """A form with its gaps filled by the groups of a match; None if one cannot be filled."""
    texts: list[str] = []
    for gap in _GAP.finditer(form):
        group = next((match[name] for name in gap[1].split(",") if match[name]), "")
        text = CHANGES[gap[2]](group) if gap[2] else group
        if text is None:
            return None
        texts.append(text)
    remaining = iter(texts)
    return _GAP.sub(lambda _: next(remaining), form)


@cache
def forms() -> tuple[Form, ...]:
    """All phrases, in the order in which they are tried."""
    tables = [word_table(f"phrases/{name}") for name in _TABLES]
    rows = [(said, row) for table in tables for said, rows in table.items() for row in rows]
    return tuple(Form(said, **row) for said, row in rows)


@dataclass(frozen=True)
class Phrase:
    """A phrase that was found: its place, the message, and the edit or advice."""

    span: Span
    message: str
    help: Help
    end: int


def find(
    source: Source,
    at: int,
    place: str,
    before: int,
    leads_on: Callable[[Fix, int], bool] = lambda _, __: True,
) -> Phrase | None:
    """The phrase over the character offset `at`, None where no phrase is known.

    `place` is the kind of body that the offset stands in, `before` where the token before it ends.
    A phrase counts only where its edit, if it has one, `leads_on` up to the end of what it covers;
    one that does so up to the end of the statement comes before all others.
    """
    text = source.text
    division = _DIVISION.match(text, before)
    if division is not None and at >= before:
        sign = Span(source, division.start(1), division.end(1))
        fix = Fix("write `/`: of two ints it is the whole part", (Edit(sign, "/"),))
        return Phrase(sign, "`//` begins a comment", fix, sign.end)
    line = text.rfind("\n", 0, at) + 1
    end = text.find("\n", at)
    end = len(text) if end < 0 else end
    stop = text.find(";", at, end)
    first: Phrase | None = None
    for form in forms():
        if form.places and place not in form.places.split():
            continue
        far = len(text) if form.far else end
        for match in form.pattern.finditer(text, line, min(far, line + _PHRASE_MAX)):
            if not match.start() <= at <= match.end():
                continue
            phrase = _phrase(source, form, match)
            if phrase is None:
                continue
            if not isinstance(phrase.help, Fix) or leads_on(phrase.help, max(stop, phrase.end)):
                return phrase
            if first is None and leads_on(phrase.help, phrase.end):
                first = phrase
    return first


def _phrase(source: Source, form: Form, match: re.Match[str]) -> Phrase | None:
    """The message and edit for a match; None if it is no such phrase after all."""
    blanks = len(match[0]) - len(match[0].lstrip())
    whole = Span(source, match.start() + blanks, match.end())
    start, end = match.span("at") if "at" in form.pattern.groupindex else match.span()
    if start < 0:  # the group may be missing from the phrase
        start, end = whole.start, whole.end
    help_: Help = form.advise
    if form.by or form.write is not None:
        new = form.soter(match)
        if new is None:
            return None
        new = new.lstrip()
        shown = " ".join(new.split())
        shown = shown if len(shown) <= _SHOWN_MAX else f"{shown[:_SHOWN_MAX]}..."
        written = shown if "`" in shown else f"write `{shown}`"
        title = form.advise or (written if shown else f"leave `{match['at'].strip()}` out")
        help_ = title if form.only_shown else Fix(title, (Edit(whole, new),))
    return Phrase(Span(source, start, end), filled(form.message, match) or "", help_, match.end())


def place_of(items: Collection[str], blocks: int) -> str:
    """The kind of the present body, by the words that begin its items and the blocks around."""
    for word, kind in (("subscribes", NODE), ("der", PLANT), ("ac", MODULE)):
        if word in items:
            return kind
    if items:
        return ""
    return FUNCTION if blocks else TOP
