"""The printed grammar and the parser agree: `docs/grammar.ebnf` is run, not trusted.

The EBNF is read into rules; from these a lark grammar (Earley) is derived to accept or reject
texts, and random sentences are generated, which the parser must accept and the printer must
lay out without changing a token.
"""

from __future__ import annotations

import random
import re
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import lark
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from soter.diagnostics.diagnostic import Diagnostics, Source
from soter.language.syntax.lexer import EOF, RESERVED, lex
from soter.language.syntax.parsing.parser import parse
from soter.language.syntax.printer import format_source

if TYPE_CHECKING:
    from collections.abc import Callable

# ("seq", parts) ("alt", parts) ("many", part) ("maybe", part) ("text", t) ("name", n)
Rule = tuple[str, Any]

GRAMMAR = Path(__file__).parents[4] / "docs" / "grammar.ebnf"

#: Errors for what the end of the grammar file says lies beyond it.
BEYOND = {"S019", "S020", "S022", "S023", "S024", "S025", "L005", "S021"}

DIGITS = "[0-9]+(?:_[0-9]+)*"
TERMINALS = {
    "DURATION": rf"{DIGITS}(?:\.{DIGITS})?(?:[eE][+-]?[0-9]+)?(?:ns|us|ms|s|min|h)(?!\w)",
    "FLOAT": rf"{DIGITS}(?:\.{DIGITS}(?:[eE][+-]?[0-9]+)?|[eE][+-]?[0-9]+)",
    "INT": DIGITS,
    "STRING": r'"(?:[^"\\\n]|\\["\\nt])*"',
    "NAME": r"(?!while\b)[A-Za-z_][A-Za-z0-9_]*",
}


# ---------------------------------------------------------------- reading the EBNF


@lru_cache
def rules() -> dict[str, Rule]:
    """The rules of the grammar file by name."""
    text = re.sub(r"\(\*.*?\*\)", " ", GRAMMAR.read_text(encoding="utf-8"), flags=re.DOTALL)
    tokens = re.findall(r"'[^']*'|\w+|[=;|(){}\[\]]", text)
    rule_by_name: dict[str, Rule] = {}
    at = 0
    while at < len(tokens):
        name = tokens[at]
        assert tokens[at + 1] == "=", f"no `=` after {name}"
        rule_by_name[name], at = _alternatives(tokens, at + 2)
        assert tokens[at] == ";"
        at += 1
    return rule_by_name


def _alternatives(tokens: list[str], at: int) -> tuple[Rule, int]:
    choices: list[Rule] = []
    while True:
        parts: list[Rule] = []
        while tokens[at] not in ("|", ";", ")", "]", "}"):
            part, at = _part(tokens, at)
            parts.append(part)
        choices.append(("seq", parts))
        if tokens[at] != "|":
            return (("alt", choices) if len(choices) > 1 else choices[0]), at
        at += 1


def _part(tokens: list[str], at: int) -> tuple[Rule, int]:
    sign = tokens[at]
    if sign in "([{":
        inner, end = _alternatives(tokens, at + 1)
        assert tokens[end] == {"(": ")", "[": "]", "{": "}"}[sign]
        kind = {"(": "alt", "[": "maybe", "{": "many"}[sign]
        return ((kind, [inner]) if kind == "alt" else (kind, inner)), end + 1
    if sign.startswith("'"):
        return ("text", sign[1:-1]), at + 1
    return ("name", sign), at + 1


def texts_of(rule: Rule) -> set[str]:
    """All quoted tokens in a rule."""
    kind, value = rule
    if kind == "text":
        return {value}
    if kind in ("seq", "alt"):
        return set().union(*(texts_of(part) for part in value))
    return texts_of(value) if kind in ("many", "maybe") else set()


# ---------------------------------------------------------------- deriving a lark grammar


@lru_cache
def recogniser() -> lark.Lark:
    """A parser that knows nothing but the grammar file."""
    words = {t for rule in rules().values() for t in texts_of(rule) if t[0].isalpha()}
    lines = [f"r_{name}: {_lark(rule)}" for name, rule in rules().items()]
    contextual = [f'"{word}"' for word in sorted(words - RESERVED)]
    lines.append("r_name: NAME | " + " | ".join(contextual))
    lines += [f"{name}: /{pattern}/" for name, pattern in TERMINALS.items()]
    lines += [r"SKIP: /\s+/ | /\/\/[^\n]*/ | /\/\*[\s\S]*?\*\//", "%ignore SKIP"]
    return lark.Lark("\n".join(lines), start="r_program", parser="earley", lexer="basic")


def _lark(rule: Rule) -> str:
    kind, value = rule
    if kind == "text":
        return f'"{value}"'
    if kind == "name":
        return "r_name" if value == "NAME" else value if value in TERMINALS else f"r_{value}"
    if kind == "seq":
        return " ".join(_lark(part) for part in value)
    if kind == "alt":
        return "(" + " | ".join(_lark(part) for part in value) + ")"
    return f"({_lark(value)}){'*' if kind == 'many' else '?'}"


def grammar_accepts(text: str) -> bool:
    try:
        recogniser().parse(text)
    except lark.exceptions.UnexpectedInput:
        return False
    return True


def problems_of(text: str) -> list[str]:
    diagnostics = Diagnostics()
    parse(Source("t", text), diagnostics)
    return [d.code for d in diagnostics.items]


def assert_agreement(text: str) -> None:
    """Grammar and parser both accept, or both reject."""
    codes = problems_of(text)
    assert grammar_accepts(text) == (set(codes) <= BEYOND), codes


# ---------------------------------------------------------------- generating sentences

NAMES = ["a", "b", "x1", "Foo", "motion", "ac", "safe", "data", "on", "fault", "by", "rk4"]
_SHORTNESS: dict[int, int] = {}
LEAVES = {
    "INT": ["0", "3", "1_000"],
    "FLOAT": ["1.5", "2e-3", "0.5"],
    "DURATION": ["10ms", "1.5s", "2min"],
    "STRING": ['"a.soter"', '"x \\" y"', '""'],
    "NAME": NAMES,
}


@lru_cache
def least_depths() -> dict[str, int]:
    """The least nesting of rules that each rule can end with."""
    depths = dict.fromkeys(LEAVES, 0)
    changed = True
    while changed:
        changed = False
        for name, rule in rules().items():
            depth = _least(rule, depths) + 1
            if depth < depths.get(name, 10_000):
                depths[name] = depth
                changed = True
    return depths


def _least(rule: Rule, depths: dict[str, int]) -> int:
    kind, value = rule
    if kind == "name":
        return depths.get(value, 10_000)
    if kind == "seq":
        return max((_least(part, depths) for part in value), default=0)
    if kind == "alt":
        return min(_least(part, depths) for part in value)
    return 0


def sentence(rng: random.Random, rule: Rule, depth: int) -> list[str]:
    """Tokens of a random sentence of a rule; past `depth` the shortest way out is taken."""
    kind, value = rule
    if kind == "text":
        return [value]
    if kind == "name":
        if value in LEAVES:
            return [rng.choice(LEAVES[value])]
        return sentence(rng, rules()[value], depth - 1)
    if kind == "seq":
        return [token for part in value for token in sentence(rng, part, depth)]
    if kind == "alt":
        able = [part for part in value if _shortness(part) <= depth]
        return sentence(rng, rng.choice(able) if able else min(value, key=_shortness), depth)
    times = 0 if depth <= 0 else rng.choice([0, 0, 1, 1, 2] if kind == "many" else [0, 1])
    return [token for _ in range(times) for token in sentence(rng, value, depth)]


def _shortness(rule: Rule) -> int:
    """`_least` of a rule of the grammar, remembered by identity: the rules live for good."""
    if id(rule) not in _SHORTNESS:
        _SHORTNESS[id(rule)] = _least(rule, least_depths())
    return _SHORTNESS[id(rule)]


def program(seed: int, depth: int = 9) -> str:
    rng = random.Random(seed)  # noqa: S311 - test data
    tokens = sentence(rng, rules()["program"], depth)
    tokens[1] = "1"
    gaps = [" ", " ", "\n", "\n\n", "  // note\n", " /* c */ "]
    return "".join(t + rng.choice(gaps if rng.random() < 0.2 else [" "]) for t in tokens)


# ---------------------------------------------------------------- tests


def test_reserved_words_are_those_of_the_grammar_file() -> None:
    text = GRAMMAR.read_text(encoding="utf-8")
    listed = re.search(r"Reserved\s+(.*?)\.\s+Every", re.sub(r"\*\)\s*\(\*", " ", text), re.DOTALL)
    assert listed is not None
    assert set(listed[1].split()) == RESERVED


def test_every_rule_of_the_grammar_is_reachable_and_defined() -> None:
    used = {"program"}
    for rule in rules().values():
        used |= set(re.findall(r"r_(\w+)", _lark(rule)))
    assert used - {"name"} == set(rules())


def test_grammar_and_parser_accept_the_sample_files(sample: Path) -> None:
    text = sample.read_text(encoding="utf-8")
    assert problems_of(text) == []
    if len(text) < (
        5_000 if sample.parent.name == "samples" else 1_500
    ):  # the Earley parser takes milliseconds a token
        assert grammar_accepts(text)


@settings(max_examples=150, deadline=None, derandomize=True)
@given(st.integers(0, 2**32))
def test_parser_accepts_what_the_grammar_generates(seed: int) -> None:
    text = program(seed)
    assert set(problems_of(text)) <= BEYOND


@settings(max_examples=25, deadline=None, derandomize=True)
@given(st.integers(0, 2**32))
@pytest.mark.long
def test_grammar_accepts_what_it_generates(seed: int) -> None:
    assert grammar_accepts(program(seed, 9))


SMALL = """soter 1; import "a" as a;
type T = { x: float, y: int in [0, 1], }; param K: float = 2.0 in [0, 5];
fun f(x: float, y: T[2]): bool { let a = -x < 1.0 && !y[0].b ? 1 : 2; if a { a.b[1] = 1; }
elseif b { push l, 1; } else { for i in 0..3 { assert a, "b"; } }
push l, choose bool + fair choose [1, a] * choose { a, fair }; return f(a, [1, 2], { x: 1 }); }
topic t: float in { a in [0, 1] } = 1.0 max_age 2ms; extern fun g(): T from "c";
node N period 1ms { subscribes t, a.b queue 2 fault; publishes u; on takeover { } step { } }
rta R { ac N; sc M; verify { grid a.b in [0, 1] / 2; abstracts d by e: F = g(x); } }
rta Q { rest a.b < 1 moves a by 2 down, c.d by K up, e by 1 within 3s; }
plant P period 1ms { drives a = 1; state x: float in [0, 1] = 2; der x = y; measured a.b within 1; }
system S default { c: P { a = b }; module R; until 1s; force R ac; replace N by M; set K = 1; }
system L { for i in 0..2 { r[i]: P { a = r[1].b, set K = i }; force r[i].R ac; always r[i].x; } }
test C { system S; a leadsto b within 1s; eventually c within 2s; }
test D { late M.dm by 1ms; overrun a by 2ms; skip a; skip b at most 3; quantum 1us;
always invariants; input t in { 1, a } every 1s; always invariant(M.a); replace N by M; skew 1ms; }
test E { for i in 0..2 { late r[i].n by 1ms; set r[i].K = 2; a leadsto b within 1s; } system S; }
"""


def tokens_of(text: str) -> list[str]:
    tokens = lex(Source("t", text))
    return [t for t, kind in zip(tokens.texts, tokens.kinds, strict=True) if kind != EOF]


@settings(max_examples=120, deadline=None, derandomize=True)
@given(st.data())
@pytest.mark.long
def test_grammar_and_parser_agree_on_programs_with_one_token_changed(data: st.DataObject) -> None:
    declarations = SMALL.split("\n")[1:-1]
    tokens = tokens_of("soter 1;" + data.draw(st.sampled_from([*declarations, SMALL[8:]])))
    at = data.draw(st.integers(3, len(tokens) - 1))
    change = data.draw(st.sampled_from(["drop", "double", "swap", "replace", "insert"]))
    other = data.draw(st.sampled_from(sorted({*tokens_of(SMALL)} - {"leadsto"})))
    if change == "drop":
        del tokens[at]
    elif change == "double":
        tokens.insert(at, tokens[at])
    elif change == "swap":
        tokens[at - 1], tokens[at] = tokens[at], tokens[at - 1]
    elif change == "replace":
        tokens[at] = other
    else:
        tokens.insert(at, other)
    assert_agreement(" ".join(tokens))


@settings(max_examples=300, deadline=None, derandomize=True)
@given(st.integers(0, 2**32))
def test_printer_keeps_tree_and_comments_of_generated_programs(
    shape: Callable[[object], Any], seed: int
) -> None:
    text = program(seed)
    if problems_of(text):
        return
    formatted = format_source(Source("t", text), Diagnostics())
    assert formatted is not None
    before, after = lex(Source("t", text)), lex(Source("t", formatted))
    assert before.texts == after.texts
    assert len(before.comments) == len(after.comments)
    trees = [shape(parse(Source("t", t), Diagnostics())) for t in (text, formatted)]
    assert trees[0] == trees[1]
    assert format_source(Source("t", formatted), Diagnostics()) == formatted


def test_enough_generated_programs_reach_the_printer() -> None:
    clean = sum(not problems_of(program(seed)) for seed in range(200))
    assert clean >= 40
