"""Linear robots at random, as programs: masses and springs that hardly swing out, and long holds.

Purpose: `program_of`: two to four states, lightly damped, perhaps behind a lag; a PD law, clamped;
SC's period, errors, ages and what pushes drawn as well, so that for some there is a polytope that
SC keeps, for some there is none, and for some the search for one goes on and on.
Non-goals: proving them (`undecided_costs.py`); groups without a program
(`tests/unit/verify/polytope`).
"""

from __future__ import annotations

from random import Random

SHAPES = ("mass", "lagged mass", "two masses")
PROGRAM = """soter 1;
topic m: {{ {fields} }} max_age {age}ms;
topic push: float in [-{u}, {u}] = 0.0;
plant Masses period 10ms {{
  reads push;
  drives m = {{ {drives} }};
{states}
  disturbance w: float in [-{w}, {w}];
{rates}
  measured {measured};
}}
node Policy period 20ms {{ publishes push; step {{ publish push = {u}; }} }}
node Home period {period}ms {{
  subscribes m;
  publishes push;
  step {{ publish push = clamp({law}, -{u}, {u}); }}
}}
rta Held {{
  ac Policy;
  sc Home;
  period {period}ms;
  safe abs(m.p) < 1.5;
  verify {{ polytope {axes}; levels {levels}; }}
}}
system S default {{ r: Masses; module Held; until 20s; always abs(r.truth.p) < 1.5; }}
"""


def program_of(seed: int) -> str:
    """The program of a number; equal for equal numbers."""
    drawn = Random(seed)  # noqa: S311 - no secrets
    shape = SHAPES[seed % len(SHAPES)]
    swing = drawn.uniform(0.5, 3.0)
    spring, damping = swing * swing, 2 * drawn.uniform(0.005, 0.08) * swing
    stiff, u = drawn.uniform(0.2, 1.5), drawn.choice((2.0, 4.0, 8.0))
    rate = {"p": "v", "v": f"-{spring:.3f} * p - {damping:.4f} * v + push + w"}
    wide = {"p": 1.5, "v": 5.0}
    if shape == "lagged mass":
        rate["v"] = rate["v"].replace("push", "a")
        rate["a"] = f"{drawn.uniform(4.0, 12.0):.2f} * (push - a)"
        wide["a"] = u
    if shape == "two masses":
        coupled = drawn.uniform(1.0, 8.0)
        rate["v"] += f" + {coupled:.2f} * (q - p)"
        rate["q"], rate["z"] = "z", f"{coupled:.2f} * (p - q) - {damping:.4f} * z"
        wide |= {"q": 2.5, "z": 8.0}
    error = drawn.choice((0.002, 0.005, 0.01))
    names = list(rate)
    return PROGRAM.format(
        fields=", ".join(f"{x}: float" for x in names),
        drives=", ".join(f"{x}: {x}" for x in names),
        states="\n".join(f"  state {x}: float = 0.0;" for x in names),
        rates="\n".join(f"  der {x} = {rate[x]};" for x in names),
        measured=", ".join(f"m.{x} within {error}" for x in names),
        axes=", ".join(f"m.{x} in [-{wide[x]}, {wide[x]}]" for x in names),
        law=f"-{stiff * spring:.3f} * m.p - {drawn.uniform(0.2, 2.0) * swing:.3f} * m.v",
        age=10 * drawn.choice((1, 2, 4)),
        u=u,
        w=round(drawn.uniform(0.02, 0.3) * min(spring, 2.0), 3),
        period=20 * drawn.choice((1, 2, 5, 10)),
        levels=drawn.choice((2, 3)),
    )
