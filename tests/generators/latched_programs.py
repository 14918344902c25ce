"""Latches for the modules of random small programs.

Purpose: `returns after` with a button that is drawn, or chosen by a plant, and `returns never`.
Non-goals: making the programs (`small_test_programs.py`); the latches of `random_programs.py`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence
    from random import Random


def with_latches(
    declarations: Sequence[str], chance: Random, tick_ms: int
) -> tuple[list[str], list[str]]:
    """Declarations, some modules of which have a latch now, and what a system needs for it."""
    made, items = list(declarations), []
    for i, text in enumerate(declarations):
        if not text.startswith("rta ") or chance.random() > 0.35:
            continue
        if chance.random() < 0.25:
            made[i] = f"{text[:-1]}  returns never;\n}}"
            continue
        button, age = f"b{i}", chance.choice((1, 1, 2, 4)) * tick_ms
        made[i] = f"{text[:-1]}  returns after {button};\n}}"
        every = chance.choice((1, 1, 2)) * tick_ms
        drawn = chance.random() < 0.5
        if drawn:
            items.append(f"input {button} every {every}ms;")
        else:
            made.append(
                f"plant Panel{i} period {every}ms {{\n  drives {button} = s;\n"
                "  state s: bool;\n  next s = choose bool;\n}"
            )
            items.append(f"panel{i}: Panel{i};")
        made.append(f"{'input ' if drawn else ''}topic {button} : bool max_age {age}ms;")
    return made, items
