"""Latches for the modules of random small programs.

Purpose: `returns after` with a button that is drawn, or chosen by a plant, and `returns never`.
Non-goals: making the programs (`small_test_programs.py`); the latches of `random_programs.py`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from random import Random

    from generators.small_test_programs import Program


def add_latches(p: Program, chance: Random, tick_ms: int) -> None:
    """Some modules get a latch, and the system what releases it."""
    for i, text in enumerate(list(p.text)):
        if not text.startswith("rta ") or chance.random() > 0.35:
            continue
        if chance.random() < 0.25:
            p.text[i] = f"{text[:-1]}  returns never;\n}}"
            continue
        button, age = f"b{i}", chance.choice((1, 1, 2, 4)) * tick_ms
        p.text[i] = f"{text[:-1]}  returns after {button};\n}}"
        every = chance.choice((1, 1, 2)) * tick_ms
        drawn = chance.random() < 0.5
        if drawn:
            p.items.append(f"input {button} every {every}ms;")
        else:
            p.text.append(
                f"plant Panel{i} period {every}ms {{\n  drives {button} = s;\n"
                "  state s: bool;\n  next s = choose bool;\n}"
            )
            p.items.append(f"panel{i}: Panel{i};")
        p.text.append(f"{'input ' if drawn else ''}topic {button} : bool max_age {age}ms;")
        p.actors += 1
