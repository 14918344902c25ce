"""The theorem of docs/proof.md, "When the trusted part stops", on every execution of a small map.

Purpose: K_fs, K, R(H) by their definitions on whole numbers; then all that AC and the time of
the failure can do. Nothing of the prover is used.
"""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from collections.abc import Callable

HILL = 4
"""From here on the plant runs away by itself."""
LIMIT = 6
U = (-1, 0, 1)
STATES = range(-LIMIT - 4, LIMIT + 5)
DELTA = 2
"""Period of the DM; SC steps at every instant, so G = 0 and H = DELTA."""


def moved(x: int, u: int) -> int:
    drift = (x >= HILL) - (x <= -HILL)
    return max(STATES[0], min(STATES[-1], x + u + drift))


def safe(x: int) -> bool:
    return abs(x) <= LIMIT


def stop(x: int) -> int:
    del x
    return 0


def hold(x: int) -> int:
    """SC: back to 0, and on the hill it just holds the plant."""
    return max(-1, min(1, -x))


def core(law: Callable[[int], int], allowed: frozenset[int]) -> frozenset[int]:
    """The greatest set in `allowed` that the law keeps."""
    kept = allowed
    while True:
        left = frozenset(x for x in kept if moved(x, law(x)) in kept)
        if left == kept:
            return kept
        kept = left


def free(kept: frozenset[int], steps: int) -> frozenset[int]:
    """R(steps): whatever acts, it is in `kept` at every instant of [0, steps]."""
    states = kept
    for _ in range(steps):
        states = frozenset(x for x in kept if all(moved(x, u) in states for u in U))
    return states


def reached(kept: frozenset[int], given: frozenset[int]) -> set[int]:
    """States at instants at which the trusted part may stop: any AC, from any state of K."""
    seen = set(product(sorted(kept), (False,), (0,)))
    todo = list(seen)
    while todo:
        x, ac, k = todo.pop()
        ac = x in given if k == 0 else ac  # the DM decides, on this instant's state
        for u in U if ac else (hold(x),):
            more = moved(x, u), ac, (k + 1) % DELTA
            if more not in seen:
                seen.add(more)
                todo.append(more)
    return {x for x, _, _ in seen}


def ever_unsafe(x: int) -> bool:
    """Whether the law, from x on and for ever, leaves C."""
    for _ in range(3 * len(STATES)):
        if not safe(x):
            return True
        x = moved(x, stop(x))
    return False


C = frozenset(x for x in STATES if safe(x))


def test_where_sc_keeps_what_the_law_keeps_the_law_may_begin_at_any_time() -> None:
    lawful = core(stop, C)
    assert lawful == frozenset(range(-HILL + 1, HILL))
    kept = core(hold, lawful)
    given = free(kept, DELTA)
    assert given
    assert given < kept
    states = reached(kept, given)
    assert states - given, "AC does lead out of R(H)"
    assert states <= kept
    assert not any(ever_unsafe(x) for x in states)


def test_where_sc_keeps_c_alone_the_law_may_come_too_late() -> None:
    """The same DM and SC, proved safe as ever: and a trusted part that stops is not."""
    kept = core(hold, C)
    given = free(kept, DELTA)
    states = reached(kept, given)
    assert all(safe(x) for x in states)
    assert any(ever_unsafe(x) for x in states)


@pytest.mark.parametrize("late", [1, 2])
def test_a_law_that_begins_later_than_sc_would_have_acted_may_be_too_late(late: int) -> None:
    """One instant more of AC's last command than H allows, and K_fs is left."""
    kept = core(hold, core(stop, C))
    given = free(kept, DELTA)
    ends = set(given)
    for _ in range(DELTA + late):
        ends = {moved(x, u) for x in ends for u in U}
    assert any(ever_unsafe(x) for x in ends)
