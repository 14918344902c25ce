"""What a proof cannot look into is refused: choices and queues of SC. Those of AC do not matter."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from bench.recheck.models import Cart

from soter.diagnostics.diagnostic import SoterError
from soter.language.front_end import check_file, system_of
from soter.verify.enclose.compiled_enclosures import generate_enclosures, library_of
from soter.verify.problem.extract import extract

if TYPE_CHECKING:
    from soter.verify.problem.problem import Problem

SET = ("topic motion: Motion", "topic motion: Motion in { x in [-9.0, 9.0], v in [-9.0, 9.0] }")
FAST = ("publish accel = motion.v > 0.0 ? A : -A;", "publish accel = fair choose { A, -A, 0.0 };")
CAREFUL = "publish accel = clamp(-2.0 * motion.x - 2.5 * motion.v, -A, A);"
CHOOSING = (CAREFUL, f"if choose bool {{ publish accel = 0.0; }} else {{ {CAREFUL} }}")
QUEUED = (
    f"subscribes motion;\n  publishes accel;\n  step {{ {CAREFUL} }}",
    """subscribes motion queue 2;
  publishes accel;
  step { publish accel = motion.len > 0 ? clamp(-motion[0].v, -A, A) : 0.0; }""",
)
QUEUED_AC = (
    "subscribes motion;\n  publishes accel;\n  step { publish accel = motion.v > 0.0 ? A : -A; }",
    """subscribes motion queue 2;
  publishes accel;
  step { publish accel = float(motion.len); }""",
)


def problem(*changes: tuple[str, str]) -> Problem:
    text = Cart().text()
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new, 1)
    system = system_of(check_file("cart.soter", text), None)
    return extract(system, system.modules[0])


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ((CHOOSING,), "what `choose` gives"),
        ((SET, QUEUED), "what waits in the queue of `motion` cannot be enclosed"),
    ],
)
def test_an_sc_that_chooses_or_reads_a_queue_cannot_be_enclosed(
    changes: tuple[tuple[str, str], ...], why: str
) -> None:
    with pytest.raises(SoterError) as refused:
        library_of(problem(*changes))
    (diagnostic,) = refused.value.diagnostics
    assert diagnostic.code == "R007"
    assert why in diagnostic.message


def test_a_queue_that_nothing_bounds_is_no_problem_to_read() -> None:
    with pytest.raises(SoterError) as refused:
        problem(QUEUED)
    assert [d.code for d in refused.value.diagnostics] == ["R001"]


@pytest.mark.parametrize("changes", [(FAST,), (QUEUED_AC,)])
def test_nothing_is_asked_of_an_ac(changes: tuple[tuple[str, str], ...]) -> None:
    plain, changed = problem(), problem(*changes)

    def unit(p: Problem) -> str:
        return generate_enclosures(p.system, p.core, p.module, p.quantities).source

    assert unit(changed) == unit(plain)
