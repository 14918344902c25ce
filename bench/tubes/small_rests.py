"""Small modules with `rest`, drawn at random: one to four states, one or two commands.

Purpose: `drawn`, a program whose SC is a clamped feedback, or a brake, on a plant with terms of all
kinds; errors, disturbances, ages, latenesses and delays are drawn, too. `keeps`: SC keeps an
integral, a filtered value, a truth or a count, and adds a little of it to each command.
Non-goals: whether its rest is kept (most are), runs of it (`tube_loop.c`).
"""

from __future__ import annotations

import random
from dataclasses import dataclass


@dataclass(frozen=True)
class _Plant:
    """States with rates and errors; what SC answers; where it rests, and what then still moves."""

    rates: tuple[str, ...]
    laws: tuple[str, ...]
    rest: str
    moves: str = ""
    within_s: int = 3


KEPT = (
    ("i: float = 0.3", "{v} = clamp({v} - 0.1 * see.s0, -0.25, 0.3);", "{v}"),
    ("f: float", "{v} = {v} + 0.2 * (see.s0 - {v});", "0.08 * {v}"),
    ("b: bool", "if abs(see.s0) > 0.3 {{ {v} = !{v}; }}", "({v} ? 0.3 : -0.1)"),
    ("n: int in [0, 5]", "if {v} < 5 {{ {v} = {v} + 1; }}", "0.06 * float({v})"),
)
"""What SC may keep: its declaration, what a step makes of it, what is added to a command."""


def drawn(number: int, *, keeps: bool = False) -> str:
    """The program of a number."""
    r = random.Random(number)  # noqa: S311 - drawn examples
    plant = r.choice((_speeds, _speeds, _sprung, _braked, _turned))(r)
    n, m = len(plant.rates), len(plant.laws)
    names = [f"s{i}" for i in range(n)]
    wide = [r.choice((2.0, 3.0, 5.0)) for _ in names]
    moving = [i for i in range(n) if f"see.s{i} by" in plant.moves]
    sets = ", ".join(f"s{i} in [{-w}, {w}]" for i, w in enumerate(wide) if i not in moving)
    bounds = [f"abs(see.s{i}) < {8.0 if i in moving else 0.9 * wide[i]:.2f}" for i in range(n)]
    errors = [f"see.s{i} within {r.choice((0.0, 0.001, 0.01))}" for i in range(n)]
    push = r.choice((0.0, 0.01, 0.05))
    laws = ", ".join(f"u{k}: clamp({law}, -1.0, 1.0)" for k, law in enumerate(plant.laws))
    kept = KEPT[number % len(KEPT)] if keeps else ("", "", "")
    if keeps:
        laws = laws.replace(", -1.0, 1.0)", f" + {kept[2].format(v=kept[0][0])}, -1.0, 1.0)")
    wild = ", ".join(f"u{k}: choose {{ -1.0, 1.0 }}" for k in range(m))
    return "\n".join([
        "soter 1;",
        f"type See = {{ {', '.join(f'{s}: float' for s in names)} }};",
        f"type Do = {{ {', '.join(f'u{k}: float' for k in range(m))} }};",
        f"topic see: See in {{ {sets} }} max_age {r.choice((20, 40))}ms;",
        f"topic act: Do in [-1.0, 1.0] = {{ {', '.join(f'u{k}: 0.0' for k in range(m))} }};",
        f"node Ac period 20ms {{ publishes act; step {{ publish act = {{ {wild} }}; }} }}",
        *_module(r, laws, " && ".join(bounds), plant, kept),
        "plant Body period 10ms {",
        "  reads act;",
        f"  drives see = {{ {', '.join(f'{s}: {s}' for s in names)} }};",
        *[f"  state {s}: float = 0.0;" for s in names],
        f"  disturbance w: float in [{-push}, {push}];" if push and not moving else "",
        *[f"  der s{i} = {e}{_pushed(r, push, moving)};" for i, e in enumerate(plant.rates)],
        f"  measured {', '.join(errors)};",
        "}",
        "system S default { b: Body; module M; until 10s; }",
    ])  # fmt: skip


def _pushed(r: random.Random, push: float, moving: list[int]) -> str:
    return f" + {r.choice((0.5, 1.0))} * w" if push and not moving else ""


def _module(
    r: random.Random, laws: str, safe: str, plant: _Plant, kept: tuple[str, str, str]
) -> list[str]:
    """SC and the module, with times that keep R015."""
    sc = r.choice((20, 40, 50))
    dm = sc * r.choice((1, 2))
    late = [r.choice((0, 0, 1, 2)) for _ in range(4)]
    acts = r.choice((0, 1, 3))
    times = (
        f"late dm {late[0]}ms, sc {late[1]}ms; response dm {late[2]}ms, sc {late[3]}ms; "
        f"acts within {acts}ms;"
    )
    declared, changed = f"var {kept[0]}; " * bool(kept[0]), kept[1].format(v=kept[0][:1])
    step = f"{declared}step {{ {changed}publish act = {{ {laws} }}; }}"
    return [
        f"node Sc period {sc}ms {{ subscribes see; publishes act; {step} }}",
        f"rta M {{ ac Ac; sc Sc; period {dm}ms; safe {safe};",
        f"  rest {plant.rest}{plant.moves} within {plant.within_s}s; verify {{ {times} }} }}",
    ]


def _term(r: random.Random, x: str) -> str:
    """Something small of one state."""
    k = round(r.uniform(0.05, 0.3), 3)
    return r.choice((
        f"{k} * sin({x})", f"{k} * {x} * {x}", f"{k} * abs({x})", f"{k} * clamp({x}, -0.5, 0.7)",
        f"{k} * cos(2.0 * {x})", f"{k} * tanh({x}) * {x}", f"-{k} * {x} * {x} * {x}",
        f"{k} * {x} / (1.0 + {x} * {x})", f"{k} * max({x}, 0.2)", f"-{k} * {x}",
    ))  # fmt: skip


def _speeds(r: random.Random) -> _Plant:
    """Each command moves one state; others follow as filters do."""
    m = r.choice((1, 2))
    n = m + r.choice((0, 0, 1, 2)) if m == 1 else m + r.choice((0, 1))
    gains = [r.choice((1.0, 2.0, 3.0)) for _ in range(m)]
    rates = [f"{g} * act.u{k} + {_term(r, f's{r.randrange(m)}')}" for k, g in enumerate(gains)]
    if m == 2 and r.random() < 0.5:
        rates[0] += " + 0.2 * act.u1"
    rates += [f"{r.choice((0.5, 1.0, 2.0))} * (s{r.randrange(i)} - s{i})" for i in range(m, n)]
    laws = [f"{-r.choice((1.0, 2.0, 4.0))} * see.s{k}" for k in range(m)]
    rest = " && ".join(f"abs(see.s{i}) < {r.choice((0.5, 0.8, 1.0))}" for i in range(n))
    return _Plant(tuple(rates), tuple(laws), rest, within_s=r.choice((3, 6)))


def _sprung(r: random.Random) -> _Plant:
    """A mass that is led to the middle."""
    a, b = r.choice((1.0, 2.0)), r.choice((1.5, 2.5))
    rates = ("s1", f"2.0 * act.u0 + {_term(r, 's0')} - {round(r.uniform(0, 1), 2)} * s1")
    law = (f"-{a} * see.s0 - {b} * see.s1",)
    return _Plant(rates, law, "abs(see.s0) < 0.8 && abs(see.s1) < 0.6", within_s=6)


def _braked(r: random.Random) -> _Plant:
    """A speed that a brake takes away, and up to two ways that go on until it has."""
    c = r.choice((1.0, 2.0))
    n = r.choice((1, 2))
    rates = [f"0.8 * act.u0 - {c} * (0.5 + 0.5 * act.u1) * s0"]
    rates += [f"{round(r.uniform(0.3, 1.0), 2)} * s0" for _ in range(n)]
    moves = " moves " + ", ".join(f"see.s{i + 1} by 0.6" for i in range(n))
    return _Plant(tuple(rates), ("0.0", "1.0"), "abs(see.s0) < 0.4", moves, 6)


def _turned(r: random.Random) -> _Plant:
    """A heading and a way across: x' = sin(a), a' = u."""
    speed = r.choice((0.5, 1.0))
    rates = (f"{speed} * sin(s1)", f"2.0 * act.u0 + {r.choice((0.0, 0.1))} * cos(s0)")
    law = ("-1.0 * see.s0 - 2.0 * see.s1",)
    return _Plant(rates, law, "abs(see.s0) < 0.8 && abs(see.s1) < 0.5", within_s=9)
