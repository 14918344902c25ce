"""How a phrase of another language is written in Soter, where a form with gaps does not do.

Purpose: what the tables of `phrases/` name: in `<gap|change>` a change of one group's text, in `by`
the writer of a whole match. None where the match is no such phrase after all.
Non-goals: the patterns and forms (`phrases/`); filling the gaps (`foreign_phrases.py`).
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from soter.language.syntax.words import LIBRARIES, meaning, places, type_meant

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

_SHOWN_MAX = 60
TYPE = r"(?:unsigned\s+|long\s+)?[A-Za-z_]\w*"
_NO_TYPES = frozenset(
    ["return", "publish", "let", "var", "push", "else", "in", "void", "fun", "node", "rta", "plant",
     "system", "test", "topic", "const", "param", "if", "for", "while", "step", "extern"]
)  # fmt: skip
_NAMED = r"\b(\w+)\s*=(?!=)\s*"


# ---------------------------------------------------------------- changes of the text of a group


def soter_type(word: str) -> str:
    """The type of Soter for one of another language; the word itself where it is none."""
    return type_meant(" ".join(word.split()[-1:])) or word


def type_of(value: str) -> str | None:
    """The type that a value says by itself."""
    value = value.strip()
    if value in ("true", "false"):
        return "bool"
    if re.fullmatch(r"-?\d+", value):
        return "int"
    is_sum = re.fullmatch(r"[\d.eE+*/() A-Z_a-z-]+", value) and re.search(r"\d", value)
    return "float" if is_sum else None


def next_number(text: str) -> str:
    """`4` for `3`, `n + 1` for `n`."""
    return str(int(text) + 1) if text.isdigit() else f"{text} + 1"


_PARAMETER = re.compile(
    r"\s*(?:const\s+)?([A-Za-z_]\w*)\s*[&*]?\s*\b([A-Za-z_]\w*)\s*(\[\s*\w+\s*\])?\s*"
)


def parameters(text: str) -> str | None:
    """`Motion m, float xs[4]` as `m: Motion, xs: float[4]`; None where that is no such list."""
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
    """A value as it stands behind an operator: in brackets unless it is a simple one."""
    value = text.strip()
    return value if re.fullmatch(r"[\w.]+(?:\[\w+\])*(?:\([\w., ]*\))?", value) else f"({value})"


def prelude(word: str) -> str:
    """What the prelude calls a function of another language; the word itself where it has none."""
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
    columns = len(rows[0])
    if not re.search(r"\bint\b", line):
        rows = [[f"{e}.0" if re.fullmatch(r"-?\d+", e) else e for e in row] for row in rows]
    if len(rows) == 1 or columns == 1:
        return f"[{', '.join(e for row in rows for e in row)}]"
    arrays = [f"[{', '.join(row)}]" for row in rows]
    return f"[{', '.join(arrays)}]"


_ENUM = re.compile(r"^type\s+(\w+)\s*=\s*enum\s*\{([^{}]*)\}", re.MULTILINE)


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


def function_of(match: re.Match[str]) -> str | None:
    """`inside = lambda p: e` as the head of `fun inside(p: ...): bool { ... }`."""
    groups = [g for g in ("a", "b", "c", "d", "e", "ps") if g in match.re.groupindex]
    names = next((match[g] for g in groups if match[g] is not None), "")
    params = [n.split()[-1] for n in names.split(",") if n.strip()]
    result = "bool" if re.search(r"[<>!=]=?|&&|\|\||\band\b|\bor\b", match["what"]) else "float"
    listed = ", ".join(f"{n}: ..." for n in params)
    what = match["what"].strip("; }")
    shown = what if what and len(what) < _SHOWN_MAX else "..."
    return f"fun {match['name']}({listed}): {result} {{ return {shown}; }}"


def function_beside(match: re.Match[str]) -> str | None:
    """The head of a function for what stands in a step, and where to put it."""
    written = function_of(match)
    return None if written is None else f"declare it beside the nodes: `{written}`"


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


_BETWEEN = frozenset(
    ["in", "as", "to", "and", "or", "if", "else", "at", "by", "for", "per", "mod", "is", "not",
     "open", "init", "with", "implies", "between"]
)  # fmt: skip


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
    "colons": lambda text: re.sub(_NAMED, r"\1: ", text).strip(),
    "unnamed": lambda text: re.sub(_NAMED, "", text),
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
