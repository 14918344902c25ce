"""The page docs/language-card.md, from the tables that parser, diagnostics and editor read.

    .venv/bin/python docs/site/language_card.py          writes the page

Purpose: the controller language on one page: what may stand where, an example of each, its meaning.
Places and words are those that the editor completes, examples the first of docs/language.md; which
words are of the first circle docs/grammar.ebnf says. Tests hold these tables to each other.
Non-goals: the reference (docs/language.md); an example of each evidence clause.
"""

from __future__ import annotations

import re
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING

from soter.editor import language_words
from soter.language.syntax import lexer, schemes
from soter.language.syntax.parsing.literals_and_operators import PRECEDENCE

if TYPE_CHECKING:
    from collections.abc import Sequence

DOCS = Path(__file__).resolve().parents[1]
PAGE = DOCS / "language-card.md"
PLACES = {
    "file": "In a file",
    "node": "In a node",
    "rta": "In an `rta` module",
    "plant": "In a plant",
    "system": "In a system",
    "block": "Statements",
}
"""The places of the first circle, in the order of the page."""
OF_EVIDENCE = {
    "file": "a file",
    "node": "a node",
    "rta": "an `rta` module",
    "verify": "`verify { }`",
    "system": "a system",
    "faults": "`faults { }`",
    "test": "a test",
}
"""The places that evidence clauses stand in."""
WITHOUT_A_WORD = {
    "system": "`c: Cart;` is an instance of a plant, a node, a module or a system.",
    "block": "`x = 2.0;` assigns a variable, a field or an element; behind the block of an `if` may"
    " stand `elseif x < 0.0 { ... }` and `else { ... }`.",
}
"""By place, what no word leads there."""
NOT_SHOWN = {
    ("rta", "failsafe"): "failsafe accel = 0.0;",
    ("system", "module"): "module Guard;",
    ("system", "force"): "force Guard sc;",
}
"""Items of which the reference has no example in such a body."""
BEHIND = {
    "phase": "node Lamp period 10ms phase 2ms { ... }",
    "max_age": "topic motion: float max_age 20ms;",
    "unit": 'topic accel: float unit "m/s^2" in [-3.0, 3.0];',
    "queue": "subscribes motion queue 4;",
    "drop_oldest": "subscribes motion queue 4 drop_oldest;",
    "drop_newest": "subscribes motion queue 4 drop_newest;",
    "fault": "subscribes motion queue 4 fault;",
    "hold": "disturbance w: float in [-1.0, 1.0] hold 1s;",
    "substeps": "integrate rk4 substeps 4;",
    "every": "input goal every 100ms;",
    "default": "system Track default { ... }",
    "within": "measured motion within 0.1;",
}
"""By word that stands behind an item, an example of the item."""
BLOCK = re.compile(r"^```soter[^\n]*\n(.*?)^```", re.MULTILINE | re.DOTALL)
HEAD = """# The controller language on one page

What may stand where, with an example and what it means. A file begins with `soter 1;`; comments are
`// ...` and `/* ... */`. Every loop ends, every list has a length, and nothing is allocated. The
reference is [language.md](language.md).

<!-- `python docs/site/language_card.py` writes this page: change the tables that it reads. -->
"""


def first_circle() -> set[str]:
    """The words of the controller language, by the grammar."""
    grammar = (DOCS / "grammar.ebnf").read_text(encoding="utf-8")
    rules = re.sub(r"\(\*.*?\*\)", " ", grammar.split("(* The second circle")[0], flags=re.DOTALL)
    return set(re.findall(r"'([a-z_0-9]+)'", rules))


def shown() -> str:
    """The programs of docs/language.md and the items in its text, without remarks."""
    page = (DOCS / "language.md").read_text(encoding="utf-8")
    programs = "".join(m.group(1) for m in BLOCK.finditer(page))
    inline = "\n".join(re.findall(r"`([^`\n]+;)`", page))
    remark = r"\s*(//[^\n]*|/\*[^\n]*\*/)$"
    return re.sub(remark, "", programs, flags=re.MULTILINE) + inline


def example(place: str, item: str, programs: str) -> str:
    """What an item looks like in a place."""
    if (place, item) in NOT_SHOWN:
        return NOT_SHOWN[place, item]
    anywhere = place in ("file", "block")
    if not anywhere:
        bodies = rf"^{place} (?:[^\n]*\}}$|.*?^\}})"
        programs = "\n".join(re.findall(bodies, programs, re.MULTILINE | re.DOTALL))
    whole = r"(?:[^;{]*(?<!= )(?<!enum )\{|[^;]*;)"
    # not where the word is a name, as a type or what is assigned is
    led = rf"(?:^|\{{) *({item}\b(?! *[=.:,]){whole})"
    found = re.search(led, programs, re.MULTILINE)
    assert found, f"docs/language.md has no example of {item} in a {place}"
    form = re.sub(r"^([\w ]+) : ", r"\1: ", " ".join(found.group(1).split()))
    return f"{form} ... }}" if form.endswith("{") else form


def cell(text: str) -> str:
    """A text inside a table."""
    return text.replace("|", r"\|")


def table(head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    """A table of Markdown."""
    lines = [head, ("---",) * len(head), *rows]
    return "\n".join(f"| {' | '.join(map(cell, line))} |" for line in lines) + "\n"


def place_table(place: str, words: set[str], programs: str) -> str:
    """The items of a place, each with an example and its meaning."""
    items = [w for w in language_words.PLACES[place] if w.split()[0] in words]
    rows = [(f"`{example(place, w, programs)}`", language_words.WORDS[w.split()[0]]) for w in items]
    return table(("item", "meaning"), rows)


def added() -> str:
    """Words that stand behind an item of another word."""
    rows = [
        (f"`{form}`", f"`{word}`: {language_words.WORDS[word]}") for word, form in BEHIND.items()
    ]
    return table(("item", "what a word behind it means"), rows)


def types() -> str:
    """The table of types of the reference."""
    page = (DOCS / "language.md").read_text(encoding="utf-8")
    found = re.search(r"^\| type \|.*?\n\n", page, re.MULTILINE | re.DOTALL)
    assert found
    return found.group(0).rstrip("\n") + "\n"


def operators() -> str:
    """Operators from the loosest to the tightest, in a sentence."""
    by_level = groupby(sorted(PRECEDENCE.items(), key=lambda x: x[1]), key=lambda x: x[1])
    levels = [" ".join(f"`{sign}`" for sign, _ in group) for _, group in by_level]
    return ", then ".join(["`c ? a : b`", *levels, "`-x` `!x`", "`x.field` `x[i]` `f(x)`"])


def built_in() -> list[tuple[str, str]]:
    """Functions and values that are there without a declaration, with their types."""
    said = (*language_words.BUILTINS.values(), *language_words.SPECIALS.values())
    parts = [re.fullmatch(r"(\w+(?:\(.*?\))?(?:: \w+(?=\.))?)[.:] (.*)", text) for text in said]
    return [(f"`{m[1]}`", str(m[2])) for m in parts if m]


def evidence(words: set[str]) -> str:
    """The words of the second circle that begin something, by place."""
    rows = []
    for place, name in OF_EVIDENCE.items():
        items = [
            w for w in language_words.PLACES[place] if w.split()[0] not in words or place == "test"
        ]
        rows.append((name, ", ".join(f"`{w}`" for w in items)))
    return table(("in", "evidence clauses"), rows)


def page() -> str:
    """The whole page."""
    words, programs = first_circle(), shown()
    parts = [HEAD]
    for place, name in PLACES.items():
        parts += [f"## {name}\n", place_table(place, words, programs)]
        parts += [f"{WITHOUT_A_WORD[place]}\n"] if place in WITHOUT_A_WORD else []
    parts += ["## Behind an item\n", added()]
    integration = ", ".join(f"`{s}`" for s in schemes.SCHEMES)
    times = ", ".join(f"`{unit}`" for unit in lexer.UNIT_NS)
    parts += ["## Types and values\n", types()]
    parts += [f"Units of time: {times}. Schemes of integration: {integration}.\n"]
    parts += [f"Operators, from the one that binds least: {operators()}.\n"]
    parts += ["## Built in\n", table(("name", "meaning"), built_in())]
    parts += ["More functions are in [the prelude](prelude.md).\n"]
    parts += ["## What proofs, tests and deployments add\n", evidence(words)]
    parts += ["Each of them is explained in [evidence.md](evidence.md).\n"]
    return "\n".join(parts)


def main() -> None:
    """Write the page."""
    PAGE.write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    main()
