"""How precisely a tube follows SC, which costs operations.

Purpose: `PRECISIONS` are the ways in which `leading_back.py` tries to show a rest, the cheap ones
first. `text_in_precision` takes the lines out of the shared texts that a cheap one does not need.
Non-goals: the steps themselves (`tube.soter`, `answer.soter`).
"""

from __future__ import annotations

import re
from typing import NamedTuple


class Precision(NamedTuple):
    """How precisely a tube follows SC.

    Of a form `keep` columns are kept: the largest relative to the width of their state (`shares`)
    or the largest in absolute size. Each command of SC is followed in `steps` steps of the order
    `order`. If there are several, whatever one adds to a state has a symbol of its own.
    """

    keep: int
    shares: bool
    steps: int = 1
    order: int = 2


PRECISIONS = (
    Precision(6, shares=True),
    Precision(6, shares=False),
    Precision(40, shares=True),
    Precision(20, shares=True, steps=6, order=5),
    Precision(40, shares=True, steps=8, order=5),
)
PLAIN, MOST, FINE = 1, 2, 3
"""Indices of `PRECISIONS`: the default, the one with most columns in one step, and the first with
several steps."""
FINER = re.compile(r".*  // (ORDER|STEPS)\n")


def text_in_precision(text: str, precision: int) -> str:
    """The text, without the lines for several steps of a higher order if the precision has one."""
    fine = PRECISIONS[precision].steps > 1
    return text if fine else FINER.sub("", text).replace("STRIDE", "MOVED")
