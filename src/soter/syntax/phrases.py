"""The phrases of other languages that are known, and what Soter writes for them.

Purpose: the table that `idioms.py` looks into. The group `at` of a pattern is where the phrase is
told; a match never begins in the middle of another token.
Non-goals: finding them; single words (`foreign.py`).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.syntax.foreign import LIBRARIES, function_meant, type_meant

if TYPE_CHECKING:
    from collections.abc import Callable

NODE, PLANT, MODULE, FUNCTION, TOP = "node", "plant", "module", "function", "top"

_NO_TYPES = frozenset(
    ["return", "publish", "let", "var", "push", "else", "in", "void", "fun", "node", "rta", "plant",
     "system", "test", "topic", "const", "param", "if", "for", "while", "step", "extern"]
)  # fmt: skip
_EXPR = r"[^;{}=\n]+?"
_TYPE = r"(?:unsigned\s+|long\s+)?[A-Za-z_]\w*"


@dataclass(frozen=True)
class Idiom:
    """What is known of one phrase.

    `write` makes Soter of a match, None where it is no such phrase; without it `say` advises.

    The group `at` is where the phrase is told, the whole match without one; `places` are those in
    which it counts.
    """

    pattern: re.Pattern[str]
    message: str
    write: Callable[[re.Match[str]], str | None] | None = None
    say: str = ""
    places: tuple[str, ...] = ()
    sure: bool = True
    """Whether `write` gives an edit; otherwise it is only shown."""


# ---------------------------------------------------------------- how phrases are rewritten


def _type(word: str) -> str:
    return type_meant(" ".join(word.split()[-1:])) or word


def _declared(word: str) -> Callable[[re.Match[str]], str | None]:
    """`float x = 3` as `var x: float = 3`."""

    def write(match: re.Match[str]) -> str | None:
        name, of = match["name"], match["type"]
        if of in _NO_TYPES:
            return None
        size = match["size"] if "size" in match.re.groupindex else None
        return f"{word} {name}: {_type(of)}{size or ''}"

    return write


def _constant(match: re.Match[str]) -> str | None:
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


def _named_constant(match: re.Match[str]) -> str:
    name, of = match["name"], match["type"]
    if type_meant(name) and not type_meant(of):
        name, of = of, name  # `const A float`
    return f"const {name}: {_type(of)}"


_PARAMETER = re.compile(
    r"\s*(?:const\s+)?([A-Za-z_]\w*)\s*[&*]?\s*\b([A-Za-z_]\w*)\s*(\[\s*\w+\s*\])?\s*"
)


def _parameters(text: str) -> str | None:
    """`Motion m, float xs[4]` as `m: Motion, xs: float[4]`; None where that is no such list."""
    found: list[str] = []
    for part in text.split(",") if text.strip() else []:
        match = _PARAMETER.fullmatch(part)
        if match is not None and match[1] != "const":
            found.append(f"{match[2]}: {_type(match[1])}{match[3] or ''}")
        elif pair := re.fullmatch(r"\s*(?:const\s+)?(\w+\s*:\s*[\w.]+(?:\[\w+\])?)\s*", part):
            found.append(pair[1])
        else:
            return None
    return ", ".join(found)


def _head(match: re.Match[str]) -> str | None:
    parameters = _parameters(match["parameters"])
    result = match["type"]
    if parameters is None or result in _NO_TYPES:
        return None
    return f"fun {match['name']}({parameters}): {_type(result)} {{"


def _list_of_parameters(match: re.Match[str]) -> str | None:
    parameters = _parameters(match["parameters"])
    unchanged = parameters is None or parameters == match["parameters"].strip()
    return None if unchanged else f"({parameters})"


def _fields(text: str) -> str | None:
    """`float x; float v;` or `x: float, v: float` as the fields of a record type."""
    found: list[str] = []
    for part in re.split(r"[;,\n]", text):
        if not part.strip():
            continue
        pair = re.fullmatch(r"\s*(?:pub\s+)?(\w+)\s*:\s*([\w.\[\]]+)\s*", part)
        typed = re.fullmatch(rf"\s*({_TYPE})\s+(\w+)\s*(\[\w+\])?\s*", part)
        if pair:
            found.append(f"{pair[1]}: {type_meant(pair[2]) or pair[2]}")
        elif typed:
            found.append(f"{typed[2]}: {_type(typed[1])}{typed[3] or ''}")
        else:
            return None
    return ", ".join(found) or None


def _record(match: re.Match[str]) -> str | None:
    fields = _fields(match["fields"])
    return None if fields is None else f"type {match['name']} = {{ {fields} }};"


def _enum(match: re.Match[str]) -> str | None:
    members = [m.strip() for m in match["fields"].split(",") if m.strip()]
    if not members or not all(re.fullmatch(r"\w+", m) for m in members):
        return None
    return f"type {match['name']} = enum {{ {', '.join(members)} }};"


def _loop(match: re.Match[str]) -> str | None:
    high = match["high"].strip()
    if match["sign"] == "<=":
        high = str(int(high) + 1) if high.isdigit() else f"{high} + 1"
    return f"for {match['i']} in {match['low'].strip()}..{high} "


def _closed(match: re.Match[str]) -> str | None:
    high = match["high"]
    return f"{match['low']}..{int(high) + 1 if high.isdigit() else f'{high} + 1'}"


def _scoped(match: re.Match[str]) -> str | None:
    head, name = match["head"], match["name"]
    if head in LIBRARIES or head == "this":
        return function_meant(name) or name
    return f"{head}.{name}"


def _array(match: re.Match[str]) -> str | None:
    return f"{_type(match['of'])}[{match['size']}]" if match["size"] else None


def _list(match: re.Match[str]) -> str | None:
    return f"{_type(match['of'])}[<=8]"


def _comprehension(match: re.Match[str]) -> str | None:
    count = int(match["count"])
    return None if not 1 <= count <= 16 else f"[{', '.join([match['value']] * count)}]"


def _imported(match: re.Match[str]) -> str | None:
    stem = match["file"].split(".")[-1] if "." in match["file"] else match["file"]
    return f'import "{stem}.soter" as {match["as"] or stem};'


def _cast(match: re.Match[str]) -> str | None:
    of = type_meant(match["type"])
    return f"{of}({match['what']})" if of in ("float", "int") else None


def _template(form: str) -> Callable[[re.Match[str]], str | None]:
    return lambda match: match.expand(form)


def _rewired(match: re.Match[str]) -> str | None:
    return match[0].replace(":=", "=")


def _designated(match: re.Match[str]) -> str | None:
    return re.sub(r"\.\s*(\w+)\s*=\s*", r"\1: ", match[0])


# ---------------------------------------------------------------- the phrases


def _idiom(
    pattern: str,
    message: str,
    write: str | Callable[[re.Match[str]], str | None] | None = None,
    say: str = "",
    places: tuple[str, ...] = (),
    *,
    far: bool = False,
    sure: bool = True,
) -> Idiom:
    flags = re.MULTILINE | (re.DOTALL if far else 0)
    making = _template(write) if isinstance(write, str) else write
    return Idiom(re.compile(pattern, flags), message, making, say, places, sure)


IDIOMS: tuple[Idiom, ...] = (
    # declarations
    _idiom(
        r"^[ \t]*(?:static\s+)?(?P<at>(?:const|constexpr|final)\s+(?:const\s+)?"
        rf"(?P<type>{_TYPE})\s+(?P<name>\w+))(?=\s*=)",
        "the type of a constant stands behind its name and `:`",
        _named_constant,
    ),
    _idiom(
        r"^(?P<at>struct|class|record|data class|message)\s+(?P<name>\w+)\s*"
        r"\{(?P<fields>[^{}]*)\}\s*;?",
        "`{0}` is no word of Soter",
        _record,
        places=(TOP,),
        far=True,
    ),
    _idiom(
        r"^(?P<at>typedef)\s+struct\s*\w*\s*\{(?P<fields>[^{}]*)\}\s*(?P<name>\w+)\s*;",
        "`typedef` is no word of Soter",
        _record,
        places=(TOP,),
        far=True,
    ),
    _idiom(
        r"^(?P<at>enum)\s+(?:class\s+|struct\s+)?(?P<name>\w+)\s*\{(?P<fields>[^{}]*)\}\s*;?",
        "an enumeration is a type, and is declared as one",
        _enum,
        places=(TOP,),
        far=True,
    ),
    _idiom(
        r"^(?P<at>typedef)\s+enum\s*\w*\s*\{(?P<fields>[^{}]*)\}\s*(?P<name>\w+)\s*;",
        "`typedef` is no word of Soter",
        _enum,
        places=(TOP,),
        far=True,
    ),
    _idiom(
        r"^(?P<at>class)\s+(?P<name>\w+)\s*(?:final\s*)?(?::\s*(?:public|private)\s+[\w:]+"
        r"|\(\s*[\w.]+\s*\))\s*:?\s*\{",
        "there are no classes: what acts is a node",
        r"node \g<name> period 10ms {",
        places=(TOP,),
    ),
    _idiom(
        rf"^(?P<at>(?:static\s+|inline\s+)*(?P<type>{_TYPE})\s+(?P<name>\w+)\s*"
        r"\((?P<parameters>[^()]*)\))\s*\{",
        "a function begins with `fun`, and its result type stands behind",
        _head,
        places=(TOP,),
    ),
    _idiom(
        r"(?<=\bfun )\s*\w+\s*(?P<at><\s*\w+(?:\s*,\s*\w+)*\s*>)(?=\s*\()",
        "functions have no type parameters",
        lambda m: m[0].replace(m["at"], ""),
        say="leave them out, and write one function for each type",
    ),
    _idiom(
        r"^(?P<at>pub(?:\s*\(\w+\))?|public|static|export|inline|private|final|extern \"C\")\s+"
        r"(?=const|fun|type|topic|node|param|rta|plant|system|test)",
        "`{0}` is no word of Soter: a file that imports this one sees everything it declares",
        "",
        places=(TOP,),
    ),
    _idiom(
        r"(?<=\btopic )\s*(?P<name>\w+)\s*(?P<at><\s*(?P<type>[\w.]+)\s*>)",
        "the type of a topic stands behind `:`",
        lambda m: f"{m['name']}: {type_meant(m['type']) or m['type']}",
    ),
    _idiom(
        r"(?<=\btopic )\s*(?P<at>~?(?:/\w+)+)",
        "the name of a topic is one word",
        lambda m: m[0].rpartition("/")[2],
    ),
    _idiom(
        r"^(?P<at>from\s+(?P<file>[\w.]+)\s+import\s+[\w*, ]+?)(?P<as>)\s*;?$",
        "a file is imported as a whole, under a name",
        _imported,
        places=(TOP,),
        sure=False,
    ),
    _idiom(
        r"^import\s+(?P<at>(?P<file>[A-Za-z_][\w.]*))(?:\s+as\s+(?P<as>\w+))?\s*;?",
        "the name of a file stands in quotes, with its ending",
        _imported,
        places=(TOP,),
    ),
    _idiom(
        rf"^(?P<at>(?P<type>float|int|bool|double)\s+(?P<name>\w+))\s*=\s*(?P<value>{_EXPR});",
        "a constant begins with `const`",
        _constant,
        places=(TOP,),
    ),
    _idiom(
        r"^(?P<at>(?P<name>[A-Za-z_]\w*)\s*=\s*(?P<value>[^;\n={}]+?))[ \t]*(?:;|$)",
        "what is assigned at the top of a file is a constant",
        _constant,
        places=(TOP,),
    ),
    # items of bodies
    _idiom(
        r"^[ \t]*(?P<at>(?P<type>float|int|bool|double|u?int\d+(?:_t)?)\s+(?P<name>\w+))\s*"
        r"(?P<size>\[\s*\w+\s*\])?(?=\s*[=;])",
        "a variable is declared with `var`, its type behind `:`",
        _declared("var"),
        places=(NODE, FUNCTION),
    ),
    _idiom(
        r"^[ \t]*(?P<at>(?P<type>float|int|bool|double)\s+(?P<name>\w+))\s*"
        r"(?P<size>\[\s*\w+\s*\])?(?=\s*[=;])",
        "a state is declared with `state`, its type behind `:`",
        _declared("state"),
        places=(PLANT,),
    ),
    _idiom(
        r"\b(?P<name>\w+)\s*(?P<at>(?P<size>\[\s*\w+\s*\]))\s*:\s*(?P<type>\w+)(?=\s*[;=,)])",
        "the size of an array stands behind its type",
        lambda m: f"{m['name']}: {_type(m['type'])}{m['size']}",
    ),
    _idiom(
        r"\b(?P<at>state)(?=\s+\w+\s*:)", "a node keeps its values in `var`", "var", "", (NODE,)
    ),
    _idiom(r"\b(?P<at>subscribes)\b", "a plant reads topics", "reads", "", (PLANT,)),
    _idiom(r"\b(?P<at>reads)\b", "a node subscribes to topics", "subscribes", "", (NODE,)),
    _idiom(
        r"\b(?P<at>publishes)\b",
        "a plant drives topics",
        None,
        "say what each of them is: `drives motion = { x: x, v: v };`",
        (PLANT,),
    ),
    _idiom(
        r"\b(?P<at>on)\s+(?!takeover)\w+\s*\{",
        "a node is not called by what arrives: it steps by its period",
        "step {",
        "",
        (NODE,),
    ),
    _idiom(
        r"\b(?P<at>(?P<name>[A-Za-z_]\w*)')\s*=\s*(?P<value>[^;=\n]+)",
        "a derivative is declared with `der`",
        r"der \g<name> = \g<value>",
        "",
        (PLANT,),
    ),
    _idiom(
        r"(?P<at>\bd\(?(?P<name>[A-Za-z_]\w*?)\)?\s*/\s*dt)\s*=\s*(?P<value>[^;=\n]+)",
        "a derivative is declared with `der`",
        r"der \g<name> = \g<value>",
        "",
        (PLANT,),
    ),
    _idiom(
        r"\b(?P<word>der|next)\s*(?P<at>\(\s*(?P<name>\w+)\s*\))\s*=\s*(?P<value>[^;=\n]+)",
        "`{0}` is no function: the name follows it",
        r"\g<word> \g<name> = \g<value>",
        "",
        (PLANT,),
    ),
    _idiom(
        r"\b(?P<word>safe|ttf|safer|always|never|assumes|guarantees|core)\s+"
        r"(?P<at>\"(?P<what>[^\"\n]+)\")",
        "a condition stands without quotes",
        r"\g<word> \g<what>",
    ),
    _idiom(
        r"\bnode\s+\w+\s*\{[^{}\n]*(?P<at>:=)[^{}\n]*\}",
        "topics are wired with `=`",
        _rewired,
    ),
    # statements
    _idiom(
        r"\bfor\s*(?P<at>\(\s*(?:\w+\s+)?(?P<i>\w+)\s*=\s*(?P<low>[^;(){}]+);\s*(?P=i)\s*"
        r"(?P<sign><=?)\s*(?P<high>[^;(){}]+);\s*(?:\+\+\s*(?P=i)|(?P=i)\s*\+\+|(?P=i)\s*\+=\s*1)"
        r"\s*\))\s*",
        "a loop counts over a range",
        _loop,
    ),
    _idiom(
        r"\bfor\s+(?P<at>\w+\s*,\s*\w+)\s+in\s+enumerate\s*\(\s*(?P<of>\w+)\s*\)",
        "a loop has one variable",
        None,
        "count, `for i in 0..4 { ... }`, and read the element: `xs[i]`; or only read them: "
        "`for x in xs { ... }`",
    ),
    _idiom(
        r"\b(?P<low>\w+)\s*(?P<at>\.\.=|\.\.\.)\s*(?P<high>\w+)",
        "the end of a range is left out, as in `0..4`",
        _closed,
    ),
    _idiom(
        rf"(?P<lead>=\s*|\breturn\s+)(?P<a>{_EXPR})\s+(?P<at>if)\s+(?P<c>{_EXPR}|[^;{{}}\n]+?)\s+"
        r"else\s+(?P<b>[^;{}\n]+?)(?=\s*;|\s*$)",
        "a choice inside an expression is written `condition ? a : b`",
        r"\g<lead>\g<c> ? \g<a> : \g<b>",
    ),
    _idiom(
        r"(?P<at>\bif)\s+(?P<c>[^;{}\n]+?)\s*\{\s*(?P<a>[^;{}\n]+?)\s*\}\s*else\s*"
        r"\{\s*(?P<b>[^;{}\n]+?)\s*\}",
        "a choice inside an expression is written `condition ? a : b`",
        r"\g<c> ? \g<a> : \g<b>",
    ),
    _idiom(
        r"\b(?P<at>auto|val|final|const\s+auto)\s+(?P<name>\w+)(?=\s*=)",
        "`{0}` is no word of Soter",
        r"let \g<name>",
    ),
    _idiom(
        r"\b(?P<at>(?:self\.|this->|this\.)?(?P<name>(?!self\b|this\b)\w+)(?:_pub\w*)?\.publish)"
        r"\s*\((?P<what>[^;{}\n]*)\)(?=\s*;)",
        "publishing is a statement",
        r"publish \g<name> = \g<what>",
    ),
    _idiom(
        r"\bpublish\s*(?P<at>\(\s*\"?(?P<name>\w+)\"?\s*,\s*(?P<what>[^;{}\n]*)\))(?=\s*;)",
        "publishing is a statement",
        r"publish \g<name> = \g<what>",
    ),
    _idiom(
        r"^[ \t]*(?P<at>(?P<what>[^;{}=\n]+?))[ \t]*\n[ \t]*\}",
        "the value of a function is what it returns",
        lambda m: m[0].replace(m["what"], f"return {m['what']};", 1),
        places=(FUNCTION,),
        far=True,
    ),
    # expressions
    _idiom(
        r"\b(?P<at>static_cast\s*<\s*(?P<type>\w+)\s*>)\s*\((?P<what>(?:[^()]|\([^()]*\))*)\)",
        "a conversion is a call",
        _cast,
    ),
    _idiom(
        r"(?P<at>\(\s*(?P<type>float|int|double|long)\s*\))\s*"
        r"(?P<what>[A-Za-z_][\w.]*(?:\((?:[^()]|\([^()]*\))*\))?|\d[\w.]*|\((?:[^()]|\([^()]*\))*\))",
        "a conversion is a call",
        _cast,
    ),
    _idiom(
        r"(?P<at>\b(?:std::)?(?:vector|array|deque|list|List|Vec|Array|Sequence)\s*[<\[]\s*"
        r"(?P<of>\w+)\s*(?:,\s*(?P<size>\w+)\s*)?[>\]])",
        "lists and arrays say how much they hold",
        _array,
    ),
    _idiom(
        r"(?P<at>\b(?:std::)?(?:vector|array|deque|list|List|Vec|Array|Sequence)\s*[<\[]\s*"
        r"(?P<of>\w+)\s*(?:,\s*(?P<size>\w+)\s*)?[>\]])",
        "lists and arrays say how much they hold",
        _list,
        sure=False,
    ),
    _idiom(
        r"(?P<at>\[\s*(?P<of>\w+)\s*;\s*(?P<size>\w+)\s*\])",
        "the size of an array stands behind its type",
        _array,
    ),
    _idiom(
        r"\b(?P<at>(?:std::)?(?:[Oo]ption(?:al)?)\s*[<\[]\s*(?P<of>\w+)\s*[>\]])",
        "there are no optional values",
        None,
        "keep a `bool` beside the value, or a list that may be empty: `float[<=1]`",
    ),
    _idiom(
        r"(?P<at>\b(?P<head>\w+)\s*(?:::|->)\s*(?P<name>\w+))",
        "a part is named with `.`",
        _scoped,
    ),
    _idiom(
        r"\{\s*(?P<at>\.\s*\w+\s*=)[^{}\n]*\}",
        "the fields of a record are written `field: value`",
        _designated,
    ),
    _idiom(
        r"(?P<at>\[\s*(?P<value>-?\d[\w.]*)\s+for\s+\w+\s+in\s+range\s*\(\s*(?P<count>\d+)\s*\)\s*\])",
        "elements are written one by one",
        _comprehension,
    ),
    _idiom(
        r"\b(?P<at>lambda)\b[^:;\n]*:",
        "functions have names",
        None,
        "declare it beside the nodes: `fun name(x: float): float { return 2.0 * x; }`",
    ),
    _idiom(
        r"(?<![\w.])(?P<at>(?P<a>\d+),(?P<b>\d+))(?=\s*[;)])",
        "the decimal sign is a point",
        r"\g<a>.\g<b>",
    ),
    _idiom(
        r"(?<=[(,])\s*(?P<at>const)\s+(?=\w+\s*:)",
        "arguments never change",
        lambda _: "",
        places=(TOP,),
    ),
    _idiom(
        r"(?P<at>\((?P<parameters>[^()]*)\))(?=\s*(?::|->|\{))",
        "in a parameter the name comes first: `name: type`",
        _list_of_parameters,
        places=(TOP,),
    ),
)
