"""Phrases of other languages: which one stands where the parser cannot go on.

Purpose: `find` says whether the text there is a phrase of C, C++, Python, Rust, ROS or a textbook,
and which edit makes it Soter. The table of foreign declarations stands here, too. Nothing is looked
up before there is an error, and a phrase counts only where it covers the error, so no right program
is concerned.
Non-goals: the tables of `foreign_phrases.py` and `foreign_expressions.py`; single words
(`foreign_words.py`); how parsing goes on (`parsing/token_cursor.py`).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Edit, Fix
from soter.diagnostics.source import Span
from soter.language.syntax.foreign_expressions import EXPRESSIONS
from soter.language.syntax.foreign_phrases import (
    FUNCTION,
    IDIOMS,
    MODULE,
    NODE,
    PLANT,
    TOP,
    Idiom,
    idiom,
)
from soter.language.syntax.foreign_rewrites import (
    cases,
    function_of,
    parameter,
    slope_of_a_state,
    typed_value,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

    from soter.diagnostics.diagnostic import Help
    from soter.diagnostics.source import Source


_STATEMENT = r"(?:^|(?<=[;{}]))[ \t]*"

DECLARATIONS = (
    # values of declarations
    idiom(
        r"(?P<before>\b(?:topic|state|var|param|const)\s+\w+\s*:[^;\n]*?)\s+"
        r"(?P<at>default|init|initial|initially|start|value)\s*(?::|==?)?\s*(?P<v>-?[\w.\[{][^;\n]*)"
        r"(?=;)",
        "the first value stands behind `=`",
        r"\g<before> = \g<v>",
    ),
    idiom(
        r"(?P<before>\b(?:topic|state|disturbance|param)\b[^;\n]*?)"
        r"(?P<at>\b(?:in\s+(?![\[({])|(?:range|limits|bounds|between|from)\s*[\[(]?\s*)"
        r"(?P<low>-?[\dA-Z][\w.]*?)\s*(?:,|\.\.=?|\bto\b|\band\b)\s*(?P<high>-?[\dA-Z][\w.]*)"
        r"\s*[\])]?)",
        "a range is written `in [low, high]`",
        r"\g<before>in [\g<low>, \g<high>]",
    ),
    idiom(
        r"\b(?P<before>(?:var|let)\s+\w+)(?P<at>\s+)(?P<type>float|int|bool|duration)\b",
        "the type stands behind the name and `:`",
        r"\g<before>: \g<type>",
    ),
    idiom(
        r"(?P<before>\bdisturbance\s+\w+)\s*(?::\s*float)?\s*(?P<at>(?:\+-|\+/-|=|\u00b1)\s*"
        r"(?P<v>\d[\w.]*))(?=\s*;)",
        "a disturbance has a range: the worst that it can be",
        r"\g<before>: float in [-\g<v>, \g<v>]",
    ),
    idiom(
        r"(?P<before>\bmeasured\s+[\w.]+)\s*(?P<at>\+-|\+/-|by|error|bias|noise)\s*(?=[\d.])",
        "the bound of an error stands behind `within`",
        r"\g<before> within ",
    ),
    idiom(
        r"(?P<before>\bstate\s+\w+)(?P<at>\s*\(\s*(?:0|0\.0|t0)\s*\))\s*=\s*(?P<v>-?\d[\d.]*)"
        r"(?P<after>)(?=\s*;)",
        "the first value of a state stands behind its type",
        typed_value,
    ),
    idiom(
        r"\b(?:\w+(?:\.|->))*(?P<at>declare_parameter(?:<\w+>)?)\s*\(\s*\"(?P<name>\w+)\"\s*,"
        r"\s*(?P<value>[^,()\n]+)\)\s*;",
        "a parameter is declared by `param`",
        parameter,
        places=(TOP,),
    ),
    idiom(
        r"\b(?P<head>subscribes|publishes|reads)\b(?P<list>[^;\n]*?)(?P<at>\s+as\s+\w+)",
        "a topic keeps its name",
        r"\g<head>\g<list>",
        "leave `as` and the name behind it out",
    ),
    idiom(
        r"\b(?P<head>subscribes)\b(?P<list>[^;\n]*?)\s+(?P<at>(?:keep_last|depth|qos|history)\s*"
        r"[(=]?\s*(?P<n>\d+)\s*\)?)",
        "how many messages wait stands behind `queue`",
        r"\g<head>\g<list> queue \g<n>",
    ),
    idiom(
        r"(?P<before>\btopic\b[^;\n]*?)(?P<at>\s+frame(?:_id)?\s*=?\s*\"?\w+\"?)",
        "a topic has no frame: a mapping of its messages names it",
        r"\g<before>",
        "leave it out",
        places=(TOP,),
    ),
    idiom(
        r"(?P<before>\b(?:const|param|state|topic|var)\s+\w+)(?P<at>)\s*=\s*(?P<v>-?\d[\d.]*|true|"
        r"false)(?P<after>[^;\n]*)(?=;)",
        "the type stands behind the name and `:`",
        typed_value,
    ),
    idiom(
        r"(?P<before>\b(?:topic|var|state|param))\s+(?P<at>(?P<type>float|int|bool|duration)\s+"
        r"(?P<name>\w+))",
        "the type stands behind the name and `:`",
        r"\g<before> \g<name>: \g<type>",
    ),
    idiom(
        r"^type\s+(?P<name>\w+)\s*(?P<at>=\s*(?:enum\b\s*)?[{(\[]?\s*(?P<cases>\w+(?:\s*[,|]\s*\w+)+)\s*"
        r"[})\]]?)\s*(?=;)",
        "the cases of a type stand behind `enum`, in braces",
        cases,
        places=(TOP,),
    ),
    idiom(
        r"^type\s+\w+\s*=\s*enum\s*\{(?P<at>[^{}\n]*=[^{}\n]*)\}",
        "the cases of an `enum` have no numbers",
        lambda m: m[0].replace(m["at"], re.sub(r"\s*=\s*\w+", "", m["at"])),
        places=(TOP,),
    ),
    idiom(
        r"^(?P<head>fun\s+\w+\s*\([^()\n]*\)\s*:\s*[\w.]+)\s*(?P<at>=>?|->)\s*(?P<what>[^;{}\n]+);?",
        "a function has a body in braces, and says `return`",
        r"\g<head> { return \g<what>; }",
        places=(TOP,),
    ),
    idiom(
        r"^(?P<at>(?:fun|def|function)?\s*(?P<name>[a-z]\w*)\s*\((?P<ps>[\w, ]*)\)\s*(?:=|=>|->)\s*"
        r"(?P<what>[^;{}\n]+);?)",
        "a function is declared by `fun`, with its types",
        function_of,
        sure=False,
        places=(TOP,),
    ),
    idiom(
        r"^(?P<kind>node|plant)\s+(?P<name>\w+)\s*(?P<at>[(:@]?\s*(?:period|every|at|rate|freq\w*|with)?"
        r"\s*[=:(]?\s*(?P<t>\d+(?:ns|us|ms|s))(?:\s*\))?)(?=\s*\{)",
        "the period stands behind the name",
        r"\g<kind> \g<name> period \g<t>",
        places=(TOP,),
    ),
    idiom(
        r"^(?:(?P<at>default|main)\s+system\s+(?P<a>\w+)|system\s+default\s+(?P<b>\w+))(?=\s*\{)",
        "`default` stands behind the name of the system",
        lambda m: f"system {m['a'] or m['b']} default",
        places=(TOP,),
    ),
    idiom(
        r"^test\s+(?P<name>\w+)\s*(?P<at>(?:of|for|system|on|:|\()\s*(?P<system>\w+)\s*\)?)\s*\{",
        "the system of a test is an item of it",
        r"test \g<name> { system \g<system>;",
        places=(TOP,),
    ),
    idiom(
        r"^rta\s+(?P<name>\w+)\s*(?P<at>[(:]\s*(?P<ac>\w+)\s*,\s*(?P<sc>\w+)\s*\)?)\s*\{",
        "the controllers of a module are items of it",
        r"rta \g<name> { ac \g<ac>; sc \g<sc>;",
        places=(TOP,),
    ),
    idiom(
        r"^rta\s+(?P<name>\w+)\s*(?P<at>period\s+(?P<t>\w+))\s*\{",
        "the period of a module is an item of it",
        r"rta \g<name> { period \g<t>;",
        places=(TOP,),
    ),
    idiom(
        r"^(?P<at>output|internal|local|global)\s+(?=topic\b)",
        "`{0}` is no word of Soter: only what the environment sets is marked, as `input`",
        "",
        places=(TOP,),
    ),
    # items
    idiom(
        r"\b(?P<kind>node|module)\s+(?P<at>(?P<names>\w+(?:\s*,\s*\w+)+))(?=\s*;)",
        "each part of a system is an item of its own",
        lambda m: "; ".join(f"{m['kind']} {n.strip()}" for n in m["names"].split(",")),
    ),
    idiom(
        r"(?P<at>\bnode\s+(?P<name>\w+)\s*:\s*(?P<what>\w+))(?=\s*;)",
        "a node of a system goes by the name that it is declared with",
        r"node \g<what>",
    ),
    idiom(
        r"\b(?P<word>subscribes|publishes|reads)\s*(?P<at>[\[({]\s*(?P<names>[\w.]+(?:\s*,\s*[\w.]+)*)\s*"
        r"[\])}])(?=\s*;)",
        "the names of topics stand between commas, without brackets",
        r"\g<word> \g<names>",
    ),
    idiom(
        r"\b(?P<word>subscribes|publishes|reads)\s+(?P<names>[\w.]+)(?P<at>\s*(?::|as|->)\s*[\w.]+)(?=\s*;)",
        "a topic goes by its name, and has the type that it is declared with",
        r"\g<word> \g<names>",
    ),
    idiom(
        r"\bpublishes\s+(?P<name>\w+)(?P<at>\s*=\s*[^;\n]+)(?=;)",
        "`publishes` says which topics; a step gives the values",
        r"publishes \g<name>",
        places=(NODE,),
    ),
    idiom(
        r"\bstep\s*(?P<at>\([^()\n]*\)\s*(?::|->\s*\w+)?|->|:)\s*(?=\{)",
        "a step has no arguments and no result",
        "step ",
        "leave them out: `step { ... }`",
        places=(NODE,),
    ),
    idiom(
        r"(?P<at>\b(?:def|void|function|fun|fn)\s+)step\s*(?:\([^()\n]*\))?\s*:?",
        "a step begins with its own word",
        "step",
        places=(NODE,),
    ),
    idiom(
        r"(?P<at>\b(?P<name>[a-zA-Z]\w*?)(?:_dot|dot|')|\bd(?P<other>\w+)|d/dt\s*(?P<third>\w+))\s*=(?!=)\s*"
        r"(?P<what>[^;\n]+)(?=;)",
        "a derivative is declared with `der`",
        slope_of_a_state,
        places=(PLANT,),
    ),
    idiom(
        r"\b(?P<name>[A-Za-z]\w*)\s*(?P<at>[\[(]\s*\w+\s*\+\s*1\s*[\])])\s*=\s*(?P<what>[^;\n]+)(?=;)",
        "the state after a period is declared with `next`",
        lambda m: (
            f"next {m['name']} = "
            + re.sub(rf"\b({m['name']})\s*[\[(]\s*\w+\s*[\])]", r"\1", m["what"])
        ),
        places=(PLANT,),
    ),
    idiom(
        r"\b(?P<name>[A-Za-z]\w*)\s*(?P<at>\+=)\s*(?P<what>[^;\n]+)(?=;)",
        "a plant has equations: `der` for a derivative, `next` for the state after a period",
        r"next \g<name> = \g<name> + \g<what>",
        places=(PLANT,),
    ),
    idiom(
        r"\b(?:always|never|safe|ttf|safer)\s+(?P<at>(?:forall|exists|all|any)\s+\w+\b[^;\n]*)(?=;)",
        "there are no quantifiers",
        None,
        "ask for each element: `for i in 0..4 { always x[i] < 1.0; }` in a system",
    ),
    idiom(
        _STATEMENT + r"(?P<at>\[\]|G|AG)\s*(?P<what>\([^;\n]+\))(?=;)",
        "what holds all the time is asked with `always`",
        r"always \g<what>",
    ),
    idiom(
        _STATEMENT + r"(?P<at><>|F|AF|EF)\s*(?P<what>[^;\n]+)(?=;)",
        "what holds at some time is asked in a test",
        None,
        "write `eventually x > 1.0 within 1s;` in a `test` block",
    ),
    idiom(
        r"\binput\s+(?P<name>[\w.]+)\s+in\s*(?P<at>\[(?P<values>[^\[\]\n]+)\])",
        "an input is given single values, in braces; all of its set without `in`",
        r"input \g<name> in { \g<values> }",
    ),
    idiom(
        r"\binput\s+(?P<name>\w+)\s*(?P<at>(?:at|@|rate|period)\s+)(?=\d)",
        "how often an input changes stands behind `every`",
        r"input \g<name> every ",
    ),
    idiom(
        r"\breplace\s+(?P<a>[\w.]+)\s*(?P<at>with|=|->|to|for)\s*(?P<b>[\w.]+)(?=\s*;)",
        "what takes the place stands behind `by`",
        r"replace \g<a> by \g<b>",
    ),
    idiom(
        _STATEMENT + r"(?P<at>--|%|;;|\(\*)\s*(?P<what>[^\n]*)$",
        "a comment begins with `//`",
        lambda m: f"// {m['what'].removesuffix('*)').strip()}",
    ),
)


_FAR = 400
"""So many characters of a phrase that runs over several lines are looked at."""
_SHOWN_MAX = 200
"""So many characters of what is to be written are shown; an editor writes all of them."""


@dataclass(frozen=True)
class Phrase:
    """One phrase found: where it stands, what is said, and the edit or advice."""

    span: Span
    message: str
    help: Help
    end: int


_DIVISION = re.compile(r"[ \t]*(//)[ \t]*[\w.(-][\w.()+* -]*[])};][^\n]*")


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
    for form in (*DECLARATIONS, *EXPRESSIONS, *IDIOMS):
        if form.places and place not in form.places:
            continue
        far = len(text) if form.pattern.flags & re.DOTALL else end
        for match in form.pattern.finditer(text, line, min(far, line + _FAR)):
            if not match.start() <= at <= match.end():
                continue
            phrase = _phrase(source, form, match, place)
            if phrase is None:
                continue
            if not isinstance(phrase.help, Fix) or leads_on(phrase.help, max(stop, phrase.end)):
                return phrase
            if first is None and leads_on(phrase.help, phrase.end):
                first = phrase
    return first


def _phrase(source: Source, idiom: Idiom, match: re.Match[str], place: str) -> Phrase | None:
    blanks = len(match[0]) - len(match[0].lstrip())
    whole = Span(source, match.start() + blanks, match.end())
    start, end = match.span("at") if "at" in idiom.pattern.groupindex else match.span()
    if start < 0:  # the group may be missing from the phrase
        start, end = whole.start, whole.end
    message = idiom.message.format(*(g or "" for g in match.groups()), place=place)
    help_: Help = idiom.say
    if idiom.write is not None:
        new = idiom.write(match)
        if new is None:
            return None
        new = new.lstrip()
        shown = " ".join(new.split())
        shown = shown if len(shown) <= _SHOWN_MAX else f"{shown[:_SHOWN_MAX]}..."
        quoted = "`" in shown
        written = shown if quoted else f"write `{shown}`"
        title = idiom.say or (written if shown else f"leave `{match['at'].strip()}` out")
        help_ = Fix(title, (Edit(whole, new),)) if idiom.sure else title
    return Phrase(Span(source, start, end), message, help_, match.end())


def place_of(items: Collection[str], blocks: int) -> str:
    """The kind of body at hand, by the words that begin its items and the blocks around."""
    for word, kind in (("subscribes", NODE), ("der", PLANT), ("ac", MODULE)):
        if word in items:
            return kind
    if items:
        return ""
    return FUNCTION if blocks else TOP
