"""The phrases of other languages that are known, and what Soter writes for them.

Purpose: the table that `foreign_idioms.py` looks into. The group `at` of a pattern is where the
phrase is told; a match never begins in the middle of another token.
Non-goals: finding them; single words (`foreign_words.py`).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from soter.language.syntax.foreign_rewrites import (
    array,
    cast,
    closed,
    combined,
    comprehension,
    constant,
    declared,
    designated,
    enumeration,
    head,
    imported,
    list_of_parameters,
    list_of_unknown_size,
    loop,
    named_constant,
    record,
    rewired,
    scoped,
    soter_type,
    template,
)
from soter.language.syntax.foreign_words import LIBRARIES, type_meant

if TYPE_CHECKING:
    from collections.abc import Callable

NODE, PLANT, MODULE, FUNCTION, TOP = "node", "plant", "module", "function", "top"

_EXPR = r"[^;{}=\n]+?"
_TYPE = r"(?:unsigned\s+|long\s+)?[A-Za-z_]\w*"


@dataclass(frozen=True)
class Idiom:
    """What is known of one phrase.

    `write` makes Soter of a match, None where it is no such phrase; without it `say` advises.

    The group `at` is where the phrase is told, the whole match without one; `places` are those in
    which it counts.
    """

    expression: str
    flags: int
    message: str
    write: Callable[[re.Match[str]], str | None] | None = None
    say: str = ""
    places: tuple[str, ...] = ()
    sure: bool = True
    """Whether `write` gives an edit; otherwise it is only shown."""

    @cached_property
    def pattern(self) -> re.Pattern[str]:
        """Compiled at the first error: a right program needs none of the hundred and fifty."""
        return re.compile(self.expression, self.flags)


# ---------------------------------------------------------------- the phrases


def idiom(
    pattern: str,
    message: str,
    write: str | Callable[[re.Match[str]], str | None] | None = None,
    say: str = "",
    places: tuple[str, ...] = (),
    *,
    far: bool = False,
    sure: bool = True,
) -> Idiom:
    """One row of a table: `write` as a template or a function, `far` over several lines."""
    flags = re.MULTILINE | (re.DOTALL if far else 0)
    making = template(write) if isinstance(write, str) else write
    return Idiom(pattern, flags, message, making, say, places, sure)


IDIOMS: tuple[Idiom, ...] = (
    idiom(
        r"\b(?:[Tt]|TIME)#(?P<time>[0-9]+(?:\.[0-9]+)?(?:[num]?s|h))\b",
        "a time is its number and its unit, with nothing before them",
        r"\g<time>",
    ),
    idiom(
        r"\b(?:[Tt]|TIME)#[0-9][\w.]*",
        "a time is one number and one unit, with nothing before them",
        say="`20ms`, `1.5s`, `2min`",
    ),
    # declarations
    idiom(
        r"\b(?P<at>(?:property|invariant|spec|requirement)\s+\w+)\s*[=:]\s*(?=always\b|never\b)",
        "a property has no name, and stands in a system",
        say="write `always e;` or `never e;` in the system",
    ),
    idiom(
        r"^[ \t]*(?:static\s+)?(?P<at>(?:const|constexpr|final)\s+(?:const\s+)?"
        rf"(?P<type>{_TYPE})\s+(?P<name>\w+))(?=\s*=)",
        "the type of a constant stands behind its name and `:`",
        named_constant,
    ),
    idiom(
        r"^(?P<at>struct|class|record|data class|message)\s+(?P<name>\w+)\s*"
        r"\{(?P<fields>[^{}]*)\}[ \t]*;?",
        "`{0}` is no word of Soter",
        record,
        places=(TOP,),
        far=True,
    ),
    idiom(
        r"^(?P<at>typedef)\s+struct\s*\w*\s*\{(?P<fields>[^{}]*)\}\s*(?P<name>\w+)\s*;",
        "`typedef` is no word of Soter",
        record,
        places=(TOP,),
        far=True,
    ),
    idiom(
        r"^(?P<at>enum)\s+(?:class\s+|struct\s+)?(?P<name>\w+)\s*\{(?P<fields>[^{}]*)\}[ \t]*;?",
        "an enumeration is a type, and is declared as one",
        enumeration,
        places=(TOP,),
        far=True,
    ),
    idiom(
        r"^(?P<at>typedef)\s+enum\s*\w*\s*\{(?P<fields>[^{}]*)\}\s*(?P<name>\w+)\s*;",
        "`typedef` is no word of Soter",
        enumeration,
        places=(TOP,),
        far=True,
    ),
    idiom(
        r"^(?P<at>class)\s+(?P<name>\w+)\s*(?:final\s*)?(?::\s*(?:public|private)\s+[\w:]+"
        r"|\(\s*[\w.]+\s*\))\s*:?\s*\{",
        "there are no classes: what acts is a node",
        r"node \g<name> period 10ms {",
        places=(TOP,),
    ),
    idiom(
        rf"^(?P<at>(?:static\s+|inline\s+)*(?P<type>{_TYPE})\s+(?P<name>\w+)\s*"
        r"\((?P<parameters>[^()]*)\))\s*\{",
        "a function begins with `fun`, and its result type stands behind",
        head,
        places=(TOP,),
    ),
    idiom(
        r"(?<=\bfun )\s*\w+\s*(?P<at><\s*\w+(?:\s*,\s*\w+)*\s*>)(?=\s*\()",
        "functions have no type parameters",
        lambda m: m[0].replace(m["at"], ""),
        say="leave them out, and write one function for each type",
    ),
    idiom(
        r"^(?P<at>static)\s+(?P<topic>(?:input\s+)?topic\b[^;\n]*);",
        "`static` stands at the end of a topic",
        r"\g<topic> static;",
        places=(TOP,),
    ),
    idiom(
        r"^(?P<at>pub(?:\s*\(\w+\))?|public|static|export|inline|private|final|extern \"C\")\s+"
        r"(?=const|fun|type|topic|node|param|rta|plant|system|test)",
        "`{0}` is no word of Soter: a file that imports this one sees everything it declares",
        "",
        places=(TOP,),
    ),
    idiom(
        r"(?<=\btopic )\s*(?P<name>\w+)\s*(?P<at><\s*(?P<type>[\w.]+)\s*>)",
        "the type of a topic stands behind `:`",
        lambda m: f"{m['name']}: {type_meant(m['type']) or m['type']}",
    ),
    idiom(
        r"(?<=\btopic )\s*(?P<at>~?(?:/\w+)+)",
        "the name of a topic is one word",
        lambda m: m[0].rpartition("/")[2],
    ),
    idiom(
        rf"^(?P<at>(?:from|import)\s+(?:{'|'.join(sorted(LIBRARIES))})\b[^;\n\"]*;?)(?=\s*$)",
        "the functions and types of the prelude need no import",
        "",
        places=(TOP,),
    ),
    idiom(
        r"^(?P<at>from\s+(?P<file>[\w.]+)\s+import\s+[\w*, ]+?)(?P<as>)\s*;?$",
        "a file is imported as a whole, under a name",
        imported,
        places=(TOP,),
        sure=False,
    ),
    idiom(
        r"^import\s+(?P<at>(?P<file>[A-Za-z_][\w.]*))(?:\s+as\s+(?P<as>\w+))?\s*;?",
        "the name of a file stands in quotes, with its ending",
        imported,
        places=(TOP,),
    ),
    idiom(
        rf"^(?P<at>(?P<type>float|int|bool|double)\s+(?P<name>\w+))\s*=\s*(?P<value>{_EXPR});",
        "a constant begins with `const`",
        constant,
        places=(TOP,),
    ),
    idiom(
        r"^(?P<at>(?P<name>[A-Za-z_]\w*)\s*=\s*(?P<value>[^;\n={}]+?))[ \t]*(?:;|$)",
        "what is assigned at the top of a file is a constant",
        constant,
        places=(TOP,),
    ),
    # items of bodies
    idiom(
        r"(?:^|(?<=[;{}]))[ \t]*(?P<at>(?P<type>float|int|bool|double|u?int\d+(?:_t)?)"
        r"\s+(?P<name>\w+))(?:\s*(?P<size>\[\s*\w+\s*\]))?(?=\s*[=;])",
        "a variable is declared with `var`, its type behind `:`",
        declared("var"),
        places=(NODE, FUNCTION),
    ),
    idiom(
        r"(?:^|(?<=[;{}]))[ \t]*(?P<at>(?P<type>float|int|bool|double)\s+(?P<name>\w+))"
        r"(?:\s*(?P<size>\[\s*\w+\s*\]))?(?=\s*[=;])",
        "a state is declared with `state`, its type behind `:`",
        declared("state"),
        places=(PLANT,),
    ),
    idiom(
        r"\b(?P<name>\w+)\s*(?P<at>(?P<size>\[\s*\w+\s*\]))\s*:\s*(?P<type>\w+)(?=\s*[;=,)])",
        "the size of an array stands behind its type",
        lambda m: f"{m['name']}: {soter_type(m['type'])}{m['size']}",
    ),
    idiom(r"\b(?P<at>state)(?=\s+\w+\s*:)", "a node keeps its values in `var`", "var", "", (NODE,)),
    idiom(r"\b(?P<at>subscribes)\b", "a plant reads topics", "reads", "", (PLANT,)),
    idiom(
        r"\b(?P<word>safe|ttf|safer)\s*(?P<at>\{)\s*(?P<condition>[^{};]+?)\s*;?\s*\}",
        "a condition stands without braces",
        r"\g<word> \g<condition>;",
        places=(MODULE,),
    ),
    idiom(
        r"\b(?P<at>plant)\s+(?P<name>\w+)\s*:\s*(?P<what>\w+(?:\.\w+)?)\s*;",
        "a plant of a system has a name and no word before it",
        r"\g<name>: \g<what>;",
    ),
    idiom(
        r"\b(?P<at>plant)\s+(?P<what>\w+)\s*;",
        "a plant of a system has a name and no word before it",
        lambda m: f"{m['what'].lower()}: {m['what']};",
    ),
    idiom(r"\b(?P<at>reads)\b", "a node subscribes to topics", "subscribes", "", (NODE,)),
    idiom(
        r"\b(?P<at>publishes)(?P<rest>\s+\w+\s*=[^;]*;)",
        "a plant drives topics",
        r"drives\g<rest>",
        "write `drives`",
        (PLANT,),
    ),
    idiom(
        r"\b(?P<at>publishes)\b",
        "a plant drives topics",
        None,
        "say what each of them is: `drives motion = { x: x, v: v };`",
        (PLANT,),
    ),
    idiom(
        r"\b(?P<at>on)\s+(?!takeover)\w+\s*(?=\{)",
        "a node is not called by what arrives: it steps by its period",
        "step ",
        "",
        (NODE,),
    ),
    idiom(
        r"\b(?P<at>(?P<name>[A-Za-z_]\w*)')\s*=\s*(?P<value>[^;=\n]+)",
        "a derivative is declared with `der`",
        r"der \g<name> = \g<value>",
        "",
        (PLANT,),
    ),
    idiom(
        r"(?P<at>\bd\(?(?P<name>[A-Za-z_]\w*?)\)?\s*/\s*dt)\s*=\s*(?P<value>[^;=\n]+)",
        "a derivative is declared with `der`",
        r"der \g<name> = \g<value>",
        "",
        (PLANT,),
    ),
    idiom(
        r"\b(?P<word>der|next)\s*(?P<at>\(\s*(?P<name>\w+)\s*\))\s*=\s*(?P<value>[^;=\n]+)",
        "`{0}` is no function: the name follows it",
        r"\g<word> \g<name> = \g<value>",
        "",
        (PLANT,),
    ),
    idiom(
        r"\b(?P<word>safe|ttf|safer|always|never|assumes|guarantees|core)\s+"
        r"(?P<at>\"(?P<what>[^\"\n]+)\")",
        "a condition stands without quotes",
        r"\g<word> \g<what>",
    ),
    idiom(
        r"\b(?P<word>safe|ttf|safer)\s*(?P<at>\(\s*\w*\s*\))\s*=\s*(?P<what>[^;\n]+)(?=;)",
        "`{0}` is a condition, not a function",
        r"\g<word> \g<what>",
        places=(MODULE,),
    ),
    idiom(
        r"\bnode\s+\w+\s*\{[^{}\n]*(?P<at>:=)[^{}\n]*\}",
        "topics are wired with `=`",
        rewired,
    ),
    # statements
    idiom(
        r"\bfor\s*(?P<at>\(\s*(?:\w+\s+)?(?P<i>\w+)\s*=\s*(?P<low>[^;(){}]+);\s*(?P=i)\s*"
        r"(?P<sign><=?)\s*(?P<high>[^;(){}]+);\s*(?:\+\+\s*(?P=i)|(?P=i)\s*\+\+|(?P=i)\s*\+=\s*1)"
        r"\s*\))\s*",
        "a loop counts over a range",
        loop,
    ),
    idiom(
        r"\bfor\s+(?P<at>\w+\s*,\s*\w+)\s+in\s+enumerate\s*\(\s*(?P<of>\w+)\s*\)",
        "a loop has one variable",
        None,
        "count, `for i in 0..4 { ... }`, and read the element: `xs[i]`; or only read them: "
        "`for x in xs { ... }`",
    ),
    idiom(
        r"\b(?P<low>\w+)\s*(?P<at>\.\.=|\.\.\.)\s*(?P<high>\w+)",
        "the end of a range is left out, as in `0..4`",
        closed,
    ),
    idiom(
        rf"(?P<lead>=\s*|\breturn\s+)(?P<a>{_EXPR})\s+(?P<at>if)\s+(?P<c>{_EXPR}|[^;{{}}\n]+?)\s+"
        r"else\s+(?P<b>[^;{}\n]+?)(?=\s*;|\s*$)",
        "a choice inside an expression is written `condition ? a : b`",
        r"\g<lead>\g<c> ? \g<a> : \g<b>",
    ),
    idiom(
        r"(?P<at>\bif)\s+(?P<c>[^;{}\n]+?)\s*\{\s*(?P<a>[^;{}\n]+?)\s*\}\s*else\s*"
        r"\{\s*(?P<b>[^;{}\n]+?)\s*\}",
        "a choice inside an expression is written `condition ? a : b`",
        r"\g<c> ? \g<a> : \g<b>",
    ),
    idiom(
        r"\b(?P<at>auto|val|final|const\s+auto)\s+(?P<name>\w+)(?=\s*=)",
        "`{0}` is no word of Soter",
        r"let \g<name>",
    ),
    idiom(
        r"\b(?P<at>(?:self\.|this->|this\.)?(?P<name>(?!self\b|this\b)\w+)(?:_pub\w*)?\.publish)"
        r"\s*\((?P<what>[^;{}\n]*)\)(?=\s*;)",
        "publishing is a statement",
        r"publish \g<name> = \g<what>",
    ),
    idiom(
        r"\bpublish\s*(?P<at>\(\s*\"?(?P<name>\w+)\"?\s*,\s*(?P<what>[^;{}\n]*)\))(?=\s*;)",
        "publishing is a statement",
        r"publish \g<name> = \g<what>",
    ),
    idiom(
        r"^[ \t]*(?P<at>(?P<what>(?!(?:return|push|publish|assert|let|var)\b)[^\s;{}=][^;{}=\n]*?))"
        r"[ \t]*(?=\n[ \t]*\})",
        "the value of a function is what it returns",
        lambda m: m[0].replace(m["what"], f"return {m['what']};", 1),
        places=(FUNCTION,),
        far=True,
    ),
    idiom(
        r"\b(?P<place>[A-Za-z_][\w.\[\]]*)\s*(?P<at>(?P<sign>[-+*/%])=)\s*(?P<value>[^;=\n]+)(?=;)",
        "`{1}` is not an operator of Soter",
        combined,
    ),
    idiom(
        r"\b(?P<place>[A-Za-z_][\w.\[\]]*)\s*(?P<at>\+\+|--)(?=\s*;)",
        "`{1}` is not a statement of Soter",
        lambda m: f"{m['place']} = {m['place']} {m['at'][0]} 1",
    ),
    # expressions
    idiom(
        r"(?P<base>\b[A-Za-z_][\w.]*)\s*(?P<at>\*\*|\^)\s*(?P<power>[23])\b(?!\.)",
        "`{1}` is not an operator of Soter",
        lambda m: f"({' * '.join([m['base']] * int(m['power']))})",
    ),
    idiom(
        r"\b(?P<at>static_cast\s*<\s*(?P<type>\w+)\s*>)\s*\((?P<what>(?:[^()]|\([^()]*\))*)\)",
        "a conversion is a call",
        cast,
    ),
    idiom(
        r"(?P<what>[A-Za-z_][\w.]*(?:\[\w+\])?(?:\((?:[^()]|\([^()]*\))*\))?|\d[\w.]*"
        r"|\((?:[^()]|\([^()]*\))*\))\s+(?P<at>as\s+(?P<type>[A-Za-z]\w*))\b",
        "a conversion is a call",
        cast,
    ),
    idiom(
        r"(?P<at>\(\s*(?P<type>float|int|double|long)\s*\))\s*"
        r"(?P<what>[A-Za-z_][\w.]*(?:\((?:[^()]|\([^()]*\))*\))?|\d[\w.]*|\((?:[^()]|\([^()]*\))*\))",
        "a conversion is a call",
        cast,
    ),
    idiom(
        r"(?P<at>\b(?:std::)?(?:vector|array|deque|list|List|Vec|Array|Sequence)\s*[<\[]\s*"
        r"(?P<of>\w+)\s*(?:,\s*(?P<size>\w+)\s*)?[>\]])",
        "lists and arrays say how much they hold",
        array,
    ),
    idiom(
        r"(?P<at>\b(?:std::)?(?:vector|array|deque|list|List|Vec|Array|Sequence)\s*[<\[]\s*"
        r"(?P<of>\w+)\s*(?:,\s*(?P<size>\w+)\s*)?[>\]])",
        "lists and arrays say how much they hold",
        list_of_unknown_size,
        sure=False,
    ),
    idiom(
        r"(?P<at>\[\s*(?P<of>\w+)\s*;\s*(?P<size>\w+)\s*\])",
        "the size of an array stands behind its type",
        array,
    ),
    idiom(
        r"\b(?P<at>(?:std::)?(?:[Oo]ption(?:al)?)\s*[<\[]\s*(?P<of>\w+)\s*[>\]])",
        "there are no optional values",
        None,
        "keep a `bool` beside the value, or a list that may be empty: `float[<=1]`",
    ),
    idiom(
        r"(?P<at>\b(?P<head>\w+)\s*(?:::|->)\s*(?P<name>\w+))",
        "a part is named with `.`",
        scoped,
    ),
    idiom(
        r"\{\s*(?P<at>\.\s*\w+\s*=)[^{}\n]*\}",
        "the fields of a record are written `field: value`",
        designated,
    ),
    idiom(
        r"(?P<at>\[\s*(?P<value>-?\d[\w.]*)\s+for\s+\w+\s+in\s+range\s*\(\s*(?P<count>\d+)\s*\)\s*\])",
        "elements are written one by one",
        comprehension,
    ),
    idiom(
        r"\b(?P<at>lambda)\b[^:;\n]*:",
        "functions have names",
        None,
        "declare it beside the nodes: `fun name(x: float): float { return 2.0 * x; }`",
    ),
    idiom(
        r"(?P<before>\btopic\b[^;\n]*\s)(?P<at>timeout|deadline|lifespan)(?=\s+\d[\w.]*\s*[;=])",
        "how old a value may be is its `max_age`",
        r"\g<before>max_age",
    ),
    idiom(
        r"\b(?P<word>always|never)\s*(?P<at>\[\s*[\d.]+\w*\s*,\s*[\w.]+\s*\])\s*(?=[\w(!\-])",
        "a property is about the whole run: `until` says how long that is",
        r"\g<word> ",
    ),
    idiom(
        r"(?P<before>\bfun\s+\w+\([^()\n]*?:\s*[\w.]+)\s*(?P<at>=\s*[-\w.]+)(?=\s*[,)])",
        "parameters have no defaults: every call gives all of them",
        r"\g<before>",
    ),
    idiom(
        r"(?P<at>\b(?P<set>in\s*\[[^\]\n]*\])\s*(?P<unit>unit\s*\"[^\"\n]*\"))(?=\s*;)",
        "the unit is part of the type, and stands before the set",
        r"\g<unit> \g<set>",
    ),
    idiom(
        r"(?<![\w.])(?P<at>(?P<a>\d+),(?P<b>\d+(?:ns|us|ms|s|min|h)?))(?=\s*[;)])",
        "the decimal sign is a point",
        r"\g<a>.\g<b>",
    ),
    idiom(
        r"(?<=[(,])\s*(?P<at>const)\s+(?=\w+\s*:)",
        "arguments never change",
        lambda _: "",
        places=(TOP,),
    ),
    idiom(
        r"(?P<at>\((?P<parameters>[^()]*)\))(?=\s*(?::|->|\{))",
        "in a parameter the name comes first: `name: type`",
        list_of_parameters,
        places=(TOP,),
    ),
)
