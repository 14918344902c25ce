"""Names and first sentences of src, held to rules whose exceptions may only become fewer.

`python tests/unit/test_house_names.py` prints the figures of each room, `--list RULE ROOM` what
breaks a rule there, `--sample SEED` functions and docstrings for somebody to judge, and `--write`
writes down figures that fell.
"""

from __future__ import annotations

import argparse
import ast
import inspect
import random
import re
from collections import Counter
from importlib import import_module
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator

UNIT = Path(__file__).resolve().parent
SOTER = UNIT.parents[1] / "src" / "soter"
FIGURES = UNIT / "house_names.toml"
VARIABLES = {"what", "own", "given", "there", "said", "told"}
Documented = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef


def _toml(path: Path) -> dict[str, Any]:
    toml = import_module("tomllib" if find_spec("tomllib") else "tomli")
    read: dict[str, Any] = toml.loads(path.read_text(encoding="utf-8"))
    return read


WORDS = {rule: set(words.split()) for rule, words in _toml(UNIT / "house_words.toml").items()}


def _public() -> set[str]:
    """What users call: the functions and methods of Python's public surface."""
    surface = (UNIT.parent / "compatibility" / "public_surface.txt").read_text(encoding="utf-8")
    return set(re.findall(r"\.(\w+)\(", surface))


PUBLIC = _public()


def first_sentence(docstring: str) -> str:
    return re.split(r"(?<=[.!?])\s", " ".join(docstring.split()), maxsplit=1)[0]


def is_hollow(sentence: str) -> bool:
    """Whether only function words stand before its first "where", "that", "which" or "one".

    "One row" counts a noun; "one of", "one that" and "one." stand for a noun.
    """
    words = re.findall(r"`[^`]*`|\w[\w'-]*|[.,:;(]", sentence)
    for word, following in pairwise([*words, "."]):
        pronoun = not following[0].isalnum() or following.lower() in WORDS["empty"] | {"that"}
        if word.lower() in {"where", "that", "which"} or (word.lower() == "one" and pronoun):
            return True
        if word[0] == "`" or (word[0].isalpha() and word.lower() not in WORDS["empty"] | {"one"}):
            return False
    return False


def first_word(name: str) -> str:
    return name.strip("_").partition("_")[0]


def broken_rules(node: ast.AST) -> Iterator[tuple[str, str]]:
    """Each rule that a piece of a file breaks, and by what."""
    if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
        gives = ast.unparse(node.returns).strip("'\"") if node.returns else ""
        setter = any(ast.unparse(d).endswith(".setter") for d in node.decorator_list)
        special = setter or node.name.startswith("__")
        if gives == "None" and not special and first_word(node.name) not in WORDS["verbs"]:
            yield "no_verb", node.name
        if node.name.strip("_") in WORDS["bare"] and node.name not in PUBLIC:
            yield "bare_word", node.name
    if isinstance(node, Documented):
        sentence = first_sentence(ast.get_docstring(node) or "")
        if is_hollow(sentence):
            yield "no_noun", sentence
    bound = (
        node.arg
        if isinstance(node, ast.arg)
        else node.id
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
        else node.attr
        if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store)
        else ""
    )
    if bound.strip("_") in VARIABLES:
        yield "says_nothing", bound


def trees() -> Iterator[tuple[Path, ast.Module]]:
    for path in sorted(SOTER.rglob("*.py")):
        if "templates" not in path.parts:
            yield path.relative_to(SOTER), ast.parse(path.read_text(encoding="utf-8"))


def exceptions() -> list[tuple[str, str, str]]:
    """The room, the rule and `file:line: name` of whatever breaks a rule."""
    return [
        (path.parts[0] if len(path.parts) > 1 else "soter", rule, f"{path}:{line}: {name}")
        for path, tree in trees()
        for node in ast.walk(tree)
        for rule, name in broken_rules(node)
        for line in [getattr(node, "lineno", 1)]
    ]


def figures() -> dict[str, dict[str, int]]:
    """How many exceptions each room has of each rule that it breaks."""
    by_room: dict[str, dict[str, int]] = {}
    for (room, rule), n in sorted(Counter(e[:2] for e in exceptions()).items()):
        by_room.setdefault(room, {})[rule] = n
    return by_room


def differences(
    allowed: dict[str, dict[str, int]], counted: dict[str, dict[str, int]]
) -> dict[str, tuple[int, int]]:
    """`room rule` -> how many exceptions are allowed and how many there are, if they differ."""
    keys = {(room, rule) for table in (allowed, counted) for room in table for rule in table[room]}
    pairs = {
        f"{room} {rule}": (
            allowed.get(room, {}).get(rule, 0),
            counted.get(room, {}).get(rule, 0),
        )
        for room, rule in sorted(keys)
    }
    return {key: pair for key, pair in pairs.items() if pair[0] != pair[1]}


def test_no_room_has_more_exceptions_and_fewer_are_written_down() -> None:
    assert differences(_toml(FIGURES), figures()) == {}


def _rules_broken_in(source: str) -> list[tuple[str, str]]:
    return [broken for node in ast.walk(ast.parse(source)) for broken in broken_rules(node)]


def test_each_rule_finds_what_breaks_it() -> None:
    assert _rules_broken_in("def cycle() -> None: ...") == [("no_verb", "cycle")]
    assert _rules_broken_in("def report_cycle() -> None: ...") == []
    assert _rules_broken_in("@cycle.setter\ndef cycle() -> None: ...") == []
    assert _rules_broken_in("def cycle() -> int: ...") == []
    assert _rules_broken_in("def _of(x: int) -> int: ...") == [("bare_word", "_of")]
    assert _rules_broken_in("def constant(x: int) -> int: ...") == []
    assert _rules_broken_in("def f(what: int) -> int: ...") == [("says_nothing", "what")]
    assert _rules_broken_in("self.told, x = y") == [("says_nothing", "told")]
    assert _rules_broken_in("x = what.told") == []


def test_a_sentence_without_a_noun_is_found() -> None:
    for sentence in (
        "One that is older as it is seen is spent.",
        "It is where all is exact; and where it is short.",
        "Which of some names was probably meant.",
        "As it is where it lies on the axis.",
    ):
        assert is_hollow(sentence), sentence
    for sentence in (
        "A press that is older than `max_age` no longer counts.",
        "One row for a record.",
        "`x`, as an int if one operand is.",
        "Whether a plant is one that `abstracts` names.",
        "",
    ):
        assert not is_hollow(sentence), sentence
    assert first_sentence("Adds\nx. That is all.") == "Adds x."


def test_what_differs_from_the_figures_is_told() -> None:
    allowed = {"core": {"no_verb": 2, "no_noun": 1}, "attic": {"no_verb": 1}}
    counted = {"core": {"no_verb": 3, "no_noun": 1}, "cli": {"bare_word": 1}}
    assert differences(allowed, counted) == {
        "attic no_verb": (1, 0),
        "cli bare_word": (0, 1),
        "core no_verb": (2, 3),
    }


def _print_sample(seed: int) -> None:
    """60 functions, drawn, and the docstrings of 48 others that have one."""
    functions = [
        (path, node)
        for path, tree in trees()
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    ]
    drawn = random.Random(seed).sample(functions, len(functions))  # noqa: S311 - no secret
    for path, node in drawn[:60]:
        heading = f"{path}:{node.lineno} {node.name}({ast.unparse(node.args)})"
        print(heading, "->", ast.unparse(node.returns) if node.returns else "")
    print()
    for path, node in [(p, n) for p, n in drawn[60:] if ast.get_docstring(n)][:48]:
        print(
            f"{path}:{node.lineno} {node.name}: {inspect.cleandoc(ast.get_docstring(node) or '')}"
        )


def main() -> None:
    arguments = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    arguments.add_argument("--list", nargs=2, metavar=("RULE", "ROOM"))
    arguments.add_argument("--sample", type=int, metavar="SEED")
    arguments.add_argument("--write", action="store_true")
    options = arguments.parse_args()
    if options.list:
        rule, room = options.list
        print(*(place for r, u, place in exceptions() if (u, r) == (rule, room)), sep="\n")
        return
    if options.sample is not None:
        _print_sample(options.sample)
        return
    counted = figures()
    rules = sorted({rule for room in counted.values() for rule in room})
    for room, by_rule in counted.items():
        print(room, ", ".join(f"{rule} {n}" for rule, n in by_rule.items()))
    print("all", ", ".join(f"{r} {sum(c.get(r, 0) for c in counted.values())}" for r in rules))
    rose = {k: p for k, p in differences(_toml(FIGURES), counted).items() if p[1] > p[0]}
    if rose:
        print("more than is allowed:", rose)
    elif options.write:
        lines = [
            f"{room} = {{ {', '.join(f'{rule} = {n}' for rule, n in by_rule.items())} }}\n"
            for room, by_rule in counted.items()
        ]
        head = [x for x in FIGURES.read_text(encoding="utf-8").splitlines(True) if x[0] == "#"]
        FIGURES.write_text("".join(head + lines), encoding="utf-8")


if __name__ == "__main__":
    main()
