"""How a phrase of another language is rewritten: from a match to Soter.

Purpose: one function for each kind of phrase; None where the match is none after all.
Non-goals: the patterns (`foreign_phrases.py`).
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from soter.language.syntax.clause_words import PLACES
from soter.language.syntax.foreign_words import LIBRARIES, function_meant, type_meant

if TYPE_CHECKING:
    from collections.abc import Callable

_SHOWN_MAX = 60
_TYPE = r"(?:unsigned\s+|long\s+)?[A-Za-z_]\w*"
_NO_TYPES = frozenset(
    ["return", "publish", "let", "var", "push", "else", "in", "void", "fun", "node", "rta", "plant",
     "system", "test", "topic", "const", "param", "if", "for", "while", "step", "extern"]
)  # fmt: skip


def soter_type(word: str) -> str:
    """The type of Soter for one of another language; the word itself where it is none."""
    return type_meant(" ".join(word.split()[-1:])) or word


def declared(word: str) -> Callable[[re.Match[str]], str | None]:
    """`float x = 3` as `var x: float = 3`."""

    def write(match: re.Match[str]) -> str | None:
        name, of = match["name"], match["type"]
        if of in _NO_TYPES:
            return None
        size = match["size"] if "size" in match.re.groupindex else None
        return f"{word} {name}: {soter_type(of)}{size or ''}"

    return write


def constant(match: re.Match[str]) -> str | None:
    """`A = 3.0` as `const A: float = 3.0;`, where the value says its type."""
    value = match["value"].strip()
    if re.fullmatch(r"true|false", value):
        of = "bool"
    elif re.fullmatch(r"-?\d+", value):
        of = "int"
    elif re.fullmatch(r"[\d.eE+*/() A-Z_a-z-]+", value) and re.search(r"\d", value):
        of = "float"
    else:
        return None
    return f"const {match['name']}: {of} = {value};"


def parameter(match: re.Match[str]) -> str | None:
    """`declare_parameter("K", 1.5);` as `param K: float = 1.5;`."""
    declared_so = constant(match)
    return None if declared_so is None else declared_so.replace("const", "param", 1)


def named_constant(match: re.Match[str]) -> str:
    """`const float A` and `const A float` as `const A: float`."""
    name, of = match["name"], match["type"]
    if type_meant(name) and not type_meant(of):
        name, of = of, name  # `const A float`
    return f"const {name}: {soter_type(of)}"


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


def head(match: re.Match[str]) -> str | None:
    """`float f(float x) {` as `fun f(x: float): float {`."""
    params = parameters(match["parameters"])
    result = match["type"]
    if params is None or result in _NO_TYPES:
        return None
    return f"fun {match['name']}({params}): {soter_type(result)} {{"


def list_of_parameters(match: re.Match[str]) -> str | None:
    """`(float x)` as `(x: float)`."""
    params = parameters(match["parameters"])
    unchanged = params is None or params == match["parameters"].strip()
    return None if unchanged else f"({params})"


def fields(text: str) -> str | None:
    """`float x; float v;` or `x: float, v: float` as the fields of a record type."""
    field_list: list[str] = []
    for part in re.split(r"[;,\n]", text):
        if not part.strip():
            continue
        pair = re.fullmatch(r"\s*(?:pub\s+)?(\w+)\s*:\s*([\w.\[\]]+)\s*", part)
        typed = re.fullmatch(rf"\s*({_TYPE})\s+(\w+)\s*(\[\w+\])?\s*", part)
        if pair:
            field_list.append(f"{pair[1]}: {type_meant(pair[2]) or pair[2]}")
        elif typed:
            field_list.append(f"{typed[2]}: {soter_type(typed[1])}{typed[3] or ''}")
        else:
            return None
    return ", ".join(field_list) or None


def record(match: re.Match[str]) -> str | None:
    """A struct as a record type."""
    field_list = fields(match["fields"])
    return None if field_list is None else f"type {match['name']} = {{ {field_list} }};"


def enumeration(match: re.Match[str]) -> str | None:
    """An enum as a type."""
    members = [m.strip() for m in match["fields"].split(",") if m.strip()]
    if not members or not all(re.fullmatch(r"\w+", m) for m in members):
        return None
    return f"type {match['name']} = enum {{ {', '.join(members)} }};"


def loop(match: re.Match[str]) -> str | None:
    """The head of a loop in three parts as one over a range."""
    high = match["high"].strip()
    if match["sign"] == "<=":
        high = str(int(high) + 1) if high.isdigit() else f"{high} + 1"
    return f"for {match['i']} in {match['low'].strip()}..{high} "


def closed(match: re.Match[str]) -> str | None:
    """`0..=3` as `0..4`."""
    high = match["high"]
    return f"{match['low']}..{int(high) + 1 if high.isdigit() else f'{high} + 1'}"


def scoped(match: re.Match[str]) -> str | None:
    """`std::abs` as `abs`, `a->b` and `a::b` as `a.b`."""
    head, name = match["head"], match["name"]
    if head in LIBRARIES or head == "this":
        return function_meant(name) or name
    return f"{head}.{name}"


def array(match: re.Match[str]) -> str | None:
    """`array<float, 4>` as `float[4]`."""
    return f"{soter_type(match['of'])}[{match['size']}]" if match["size"] else None


def list_of_unknown_size(match: re.Match[str]) -> str | None:
    """`vector<float>` as a list of at most eight."""
    return f"{soter_type(match['of'])}[<=8]"


def comprehension(match: re.Match[str]) -> str | None:
    """`[0.0 for i in range(2)]` as `[0.0, 0.0]`."""
    count = int(match["count"])
    return None if not 1 <= count <= 16 else f"[{', '.join([match['value']] * count)}]"


def imported(match: re.Match[str]) -> str | None:
    """An import with the name of the file in quotes."""
    stem = match["file"].split(".")[-1] if "." in match["file"] else match["file"]
    return f'import "{stem}.soter" as {match["as"] or stem};'


def cast(match: re.Match[str]) -> str | None:
    """`(float)n` as `float(n)`."""
    of = type_meant(match["type"])
    return f"{of}({match['what']})" if of in ("float", "int") else None


def template(form: str) -> Callable[[re.Match[str]], str | None]:
    """What the groups of a match are put into."""
    return lambda match: match.expand(form)


def combined(match: re.Match[str]) -> str | None:
    """`x += e` as `x = x + e`."""
    place, value = match["place"], match["value"].strip()
    simple = re.fullmatch(r"[\w.]+(?:\[\w+\])*(?:\([\w., ]*\))?", value)
    return f"{place} = {place} {match['sign']} {value if simple else f'({value})'}"


def rewired(match: re.Match[str]) -> str | None:
    """Wires with `=` for `:=`."""
    return match[0].replace(":=", "=")


def designated(match: re.Match[str]) -> str | None:
    """`.x = e` as `x: e`."""
    return re.sub(r"\.\s*(\w+)\s*=\s*", r"\1: ", match[0])


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


def loop_over(match: re.Match[str]) -> str | None:
    """`for (auto x : xs)` as `for x in xs`."""
    return f"for {match['x']} in {match['xs']}"


def loop_to(match: re.Match[str]) -> str | None:
    """`for i = 1 to 4` and `for i in 1:4` as `for i in 1..5`."""
    high = match["high"]
    end = str(int(high) + 1) if high.isdigit() else f"{high} + 1"
    return f"for {match['x']} in {match['low']}..{end}"


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


def record_value(match: re.Match[str]) -> str | None:
    """`Pose(x=1.0, y=2.0)` as `{ x: 1.0, y: 2.0 }`."""
    fields = re.sub(_NAMED, r"\1: ", match["fields"]).strip()
    return f"{{ {fields} }}"


def positional(match: re.Match[str]) -> str | None:
    """`f(x=1.0)` as `f(1.0)`."""
    return f"{match['name']}({re.sub(_NAMED, '', match['arguments'])})"


_NAMED = r"\b(\w+)\s*=(?!=)\s*"


def matrix(match: re.Match[str]) -> str | None:
    """`[1 0; 0 1]` as `[[1.0, 0.0], [0.0, 1.0]]`, `[1 2]` as `[1.0, 2.0]`, `[0.0; 2]` in full.

    Whole numbers become floats unless the line speaks of an int; a factor is no array.
    """
    line = match.string[match.string.rfind("\n", 0, match.start()) + 1 : match.start()]
    around = line.rstrip()[-1:] + match.string[match.end() :].lstrip()[:1]
    rows = [re.split(r"\s*,\s*|[ \t]+", row.strip()) for row in match["rows"].split(";")]
    ragged = len({len(row) for row in rows}) > 1
    if ragged or "*" in around or not re.match(r"-?[\d.]", rows[0][0]):
        return None
    columns = len(rows[0])
    if len(rows) == 2 and columns == 1 and re.fullmatch(r"[2-9]|1[0-6]", rows[1][0]):
        rows = rows[:1] * int(rows[1][0])
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


def between(match: re.Match[str]) -> str | None:
    """`x in [0, 1]` as two comparisons; None for cases of an enum, which have no order."""
    low, x, high = match["low"], match["x"], match["high"]
    if re.fullmatch(r"[A-Z]\w*\.[A-Z]\w*", low):
        return None
    return f"{low} <= {x} && {x} <= {high}"


def of_any_type(match: re.Match[str]) -> str | None:
    """`std::min<int>` as `min`."""
    return function_meant(match["name"]) or match["name"]


def two_by_two(match: re.Match[str]) -> str | None:
    """`min({a, b, c})` as `min(a, min(b, c))`."""
    *rest, whole = [v.strip() for v in match["values"].split(",")]
    for value in reversed(rest):
        whole = f"{match['fun']}({value}, {whole})"
    return whole if rest else None


def typed_value(match: re.Match[str]) -> str | None:
    """`state x = 0.0` as `state x: float = 0.0`."""
    value = match["v"]
    of = "bool" if value in ("true", "false") else "int" if value.lstrip("-").isdigit() else "float"
    return f"{match['before']}: {of} = {value}{match['after']}"


def cases(match: re.Match[str]) -> str | None:
    """`type E = { A, B }` and `type E = A | B` as `type E = enum { A, B }`."""
    names = ", ".join(re.findall(r"[A-Za-z_]\w*", match["cases"]))
    return f"type {match['name']} = enum {{ {names} }}"


def slope_of_a_state(match: re.Match[str]) -> str | None:
    """`x_dot = e` and `dx = e` as `der x = e`, where the file has that state."""
    name = match["name"] or match["other"] or match["third"]
    declared = re.search(rf"\bstate\s+{name}\b", match.string)
    return f"der {name} = {match['what']}" if declared else None


_BETWEEN = frozenset(
    ["in", "as", "to", "and", "or", "if", "else", "at", "by", "for", "per", "mod", "is", "not",
     "open", "init", "with", "implies", "between", *PLACES]
)  # fmt: skip


def product(match: re.Match[str]) -> str | None:
    """`2 x` as `2 * x`, unless the word is one of the language or a unit of time."""
    word = match["x"]
    unit = re.fullmatch(r"(?:[num]?s|min|h|hz|Hz|sec\w*|m|deg|rad)", word)
    return None if unit or word in _BETWEEN else f"{match['n']} * {word}"
