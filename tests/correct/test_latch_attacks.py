"""Latches under anything that may be sent: only an edge that the decision module saw gives back.

Purpose: presses and releases of any time, repeated, swapped, of the future, against what an
operator has to do, worked out anew from the looks; both engines stay alike.
Non-goals: misuses one by one (`test_latch.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from correct.test_latch import AGE, MS, TWO, Robot
from generators.engine_comparison import compile_library, subject
from tables import all_rows

if TYPE_CHECKING:
    from collections.abc import Callable


@pytest.fixture(scope="module")
def robots(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Robot]:
    """Makes a robot at its start: one that looks every 10 ms, and one that does every 7."""
    subjects = {
        "two": subject("two", TWO, 1, 10),
        "odd": subject("odd", TWO.replace("period 10ms", "period 7ms"), 1, 10),
    }
    library = compile_library(list(subjects.values()), tmp_path_factory.mktemp("latch"), "-O2")
    return lambda name: Robot(subjects[name], library)


class Operator:
    """What may give control back, by what the decision module saw at its looks, worked out anew."""

    def __init__(self) -> None:
        self.looks: list[tuple[float, bool, float]] = []
        """When, what the button showed then, and when that was measured."""
        self.since: float | None = None
        """The takeover, or the first look."""

    def acknowledged(self, now: float) -> bool:
        """Some look saw a release, a later one a press of after that, which is young still."""
        after = [x for x in self.looks if self.since is not None and x[2] > self.since]
        return any(
            not released and pressed and at > stamp and now - at <= AGE and seen_at - at <= AGE
            for i, (_, released, stamp) in enumerate(after)
            for seen_at, pressed, at in after[i + 1 :]
        )


@all_rows("name", ["two", "odd"])
@all_rows("seed", range(12))
def test_whatever_is_sent_control_comes_back_by_a_new_edge_alone(
    name: str, seed: int, robots: Callable[[str], Robot]
) -> None:
    """Presses and releases of any time, repeated, swapped, of the future; danger comes and goes.

    Looks every 7 ms meet no message of a panel that sends every 10 ms at the same time twice.
    """
    chance = np.random.default_rng(seed)
    r, operator = robots(name), Operator()
    button, period = r.subject.system.topic("button").index, 10 if name == "two" else 7
    sent: list[tuple[bool, float]] = [(False, 0.0)]
    returns = 0
    r.tell(0, "danger", 0)
    for look in range(0, 2_000, period):
        for _ in range(int(chance.integers(0, 4))):
            ms = look - period * float(chance.uniform(0.05, 0.95))
            if ms * MS <= r.c.ct or ms <= 0:
                continue
            pick = chance.random()
            value = bool(chance.random() < 0.5)
            measured = ms - float(chance.choice([0.0, 1.0, 30.0, 70.0])) * chance.random()
            if pick < 0.2:
                value, measured = sent[int(chance.integers(len(sent)))]
            elif pick < 0.3:
                measured = ms + 20
            if r.tell(ms, "button", value, measured=measured):
                sent.append((value, measured))
            if chance.random() < 0.06:
                r.tell(ms + 1e-3, "danger", int(chance.integers(0, 3)))
        before = r.mode()
        r.until(look)
        after = r.mode()
        shown, stamp = bool(r.c.Topics[button]), r.c.stamps[button] / MS
        if operator.since is None:
            operator.since = float(look)
        operator.looks.append((float(look), shown, stamp))
        if (before, after) == ("SC", "AC"):
            assert operator.acknowledged(look), look
            operator.looks.clear()
            returns += 1
        elif (before, after) == ("AC", "SC"):
            operator.looks.clear()
            operator.since = float(look)
    assert returns
