"""Hints are put where a person would write them, and nothing else of a program changes."""

from __future__ import annotations

from itertools import product

import pytest

from soter.diagnostics.diagnostic import Diagnostics, Source
from soter.language.front_end import check_file
from soter.language.syntax.lexer import lex
from soter.language.syntax.printer import format_source
from soter.verify.search.hint_text import COMMENT, Hints, with_hints

TEMPLATE = """soter 1;
topic x: float max_age 20ms;
topic u: float in [-1.0, 1.0];
plant P period 10ms {{ reads u; drives x = p; state p: float; der p = u; }}
node Fast period 20ms {{ publishes u; step {{ publish u = 1.0; }} }}
node Slow period 20ms {{ subscribes x; publishes u; step {{ publish u = clamp(-x, -1.0, 1.0); }} }}
rta M {{  // grid, rest; verify {{ in a comment
  ac Fast;
  sc Slow;
  period 20ms;
  safe abs(x) < 3.0;
{own}}}
system S {{ p: P; module M; }}
"""
GRID = Hints(items=("grid x in [-3.0, 3.0] / 100;",))
REST = Hints(clauses=("rest abs(x) < 0.5 within 5s;", "shield;"))
OWN = {
    "nothing": "",
    "predicates": "  ttf abs(x) > 2.0;\n  safer abs(x) < 1.0;\n",
    "an empty block": "  verify { }\n",
    "times": "  verify {\n    late dm 1ms, sc 1ms;\n    recover never;\n  }\n",
    "a grid": "  verify { levels 2; grid x in [-2.0, 2.0] / 9; acts within 1ms; }\n",
    "a grid alone": "  verify { grid x in [-2.0, 2.0] / 9; }\n",
    "a rest": "  rest abs(x) < 0.1 within 1s;\n  shield;\n  verify { recover never; }\n",
}


def _texts(text: str) -> list[str]:
    return lex(Source("m.soter", text)).texts


@pytest.mark.parametrize("own", OWN)
@pytest.mark.parametrize("hints", [GRID, REST], ids=["grid", "rest"])
def test_a_program_with_found_hints_is_one_that_checks(own: str, hints: Hints) -> None:
    text = TEMPLATE.format(own=OWN[own])
    before = check_file("m.soter", text)
    assert before.ok, before.diagnostics.items
    assert before.program is not None
    assert before.loaded is not None
    source = before.loaded.main.source
    after = with_hints(source, before.program.modules["M"], hints, COMMENT)
    again = check_file("m.soter", after)
    assert again.ok, (after, again.diagnostics.items)
    assert again.program is not None
    module = again.program.modules["M"]
    assert (module.rest is not None) == (hints is REST)
    assert len(module.verify.groups) == (hints is GRID)
    assert (module.ttf is not None) == (hints is GRID and own == "predicates")
    assert (module.verify.stays is not None) == ("recover never" in OWN[own])
    assert (module.verify.levels is not None) == (hints is GRID and own == "a grid")
    assert (module.verify.acts is not None) == (own == "a grid")
    assert format_source(Source("m.soter", after), Diagnostics()) is not None


def test_only_hints_and_no_other_word_of_a_program_go() -> None:
    for own, hints in product(OWN.values(), (GRID, REST)):
        text = TEMPLATE.format(own=own)
        checked = check_file("m.soter", text)
        assert checked.program is not None
        assert checked.loaded is not None
        after = with_hints(checked.loaded.main.source, checked.program.modules["M"], hints)
        head, tail = text[: text.index("rta M")], text[text.index("system S") :]
        assert after.startswith(head), own
        assert after.endswith(tail), own
        kept = [w for w in ("late", "recover", "acts") if w in own]
        assert all(w in _texts(after) for w in kept), own


def test_lines_that_are_added_stand_beside_those_of_the_program() -> None:
    text = TEMPLATE.format(own=OWN["a grid"])
    checked = check_file("m.soter", text)
    assert checked.program is not None
    assert checked.loaded is not None
    hints = Hints(items=GRID.items, added=True)
    after = with_hints(checked.loaded.main.source, checked.program.modules["M"], hints)
    assert _texts(after).count("grid") == 2


@pytest.mark.parametrize("hints", [GRID, REST], ids=["grid", "rest"])
def test_lines_end_as_those_of_the_file_do(hints: Hints) -> None:
    for own in OWN.values():
        text = TEMPLATE.format(own=own).replace("\n", "\r\n")
        checked = check_file("m.soter", text)
        assert checked.program is not None
        assert checked.loaded is not None
        module = checked.program.modules["M"]
        after = with_hints(checked.loaded.main.source, module, hints, COMMENT)
        assert after.count("\n") == after.count("\r\n")
