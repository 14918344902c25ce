"""Towers of two, drawn at random and flown against: what is proved of either module holds.

    .venv/bin/python bench/adversary/towers.py [--towers 60] [--flights 20]

Purpose: each tower has a cart, thresholds, periods, delays and strengths of its own, many of them
wrong. What `soter verify` proves of the outer module, and of the inner one while the outer one is
in AC, is flown against: an AC that pushes at the border, one that flips at every release, one that
lures the state out and waits; DMs as late as declared; wind that is held. A flight that violates
what is proved is a defect (exit code 1). Of the claims that are not proved those are counted that a
flight violates: if none were, these adversaries would be no test.
Non-goals: errors and disturbances at their ends in every step (`against_proofs.py`).
"""

from __future__ import annotations

import argparse
import random
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

import soter
from soter.diagnostics.diagnostic import SoterError

PROGRAM = """soter 1;
param KIND: int = 0 in [0, 3];
topic x: float in [-5.0, 5.0] max_age {age}ms;
topic u: float in [-1.0, 1.0] = 0.0;
plant Cart period 1ms {{
  reads u;
  drives x = p;
  state p: float in [-2.6, 2.6];
  disturbance w: float in [-{wind}, {wind}] hold 200ms;
  der p = u + w;
  measured x within {error};
}}
node Any period 5ms {{
  subscribes x;
  publishes u;
  var sign: float = 1.0;
  step {{
    if KIND == 0 {{ publish u = x >= 0.0 ? 1.0 : -1.0; }}
    elseif KIND == 1 {{ publish u = choose {{ -1.0, 1.0 }}; }}
    elseif KIND == 2 {{
      if choose {{ 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15 }} == 0 {{ sign = -sign; }}
      publish u = sign;
    }} else {{ publish u = abs(x) < {lure} ? (x >= 0.0 ? 1.0 : -1.0) : 0.0; }}
  }}
}}
node Near period {sc_inner}ms {{
  subscribes x;
  publishes u;
  step {{ publish u = clamp(-{gain_inner} * x, -{most_inner}, {most_inner}); }}
}}
node Back period {sc_outer}ms {{
  subscribes x;
  publishes u;
  step {{ publish u = clamp(-{gain_outer} * x, -1.0, 1.0); }}
}}
rta Inner {{
  ac Any;
  sc Near;
  period {dm_inner}ms;
  safe abs(x) < {safe_inner};
  ttf abs(x) > {ttf_inner};
  safer abs(x) < {safer_inner};
  verify {{
    grid x in [-3.0, 3.0] / 300;
    late dm {late_inner}ms, sc 0ms;
    response dm 0ms, sc 0ms;
    acts within 0ms;
  }}
}}
rta Outer {{
  ac module Inner;
  sc Back;
  period {dm_outer}ms;
  safe abs(x) < 3.0;
  ttf abs(x) > {ttf_outer};
  safer abs(x) < {safer_outer};
  verify {{
    grid x in [-3.2, 3.2] / 320;
    late dm {late_outer}ms, sc 0ms;
    response dm 0ms, sc 0ms;
    acts within 0ms;
  }}
}}
system Lane default {{
  c: Cart;
  module Outer;
  until 60s;
  always abs(c.truth.p) < 3.0;
  always mode(Outer) == Mode.SC || abs(c.truth.p) < {safe_inner};
  faults {{
    late Outer.Inner.dm by [0ms, {late_inner}ms];
    late Outer.dm by [0ms, {late_outer}ms];
  }}
}}
"""
CLAIMS = ("Outer", "Inner")
KINDS = 4


@dataclass
class Tower:
    """One tower: what was proved, and in how many flights each claim was violated."""

    number: int
    proved: dict[str, bool] = field(default_factory=dict)
    violated: dict[str, int] = field(default_factory=dict)
    flights: int = 0
    given_back: int = 0
    """How often the outer module gave control back."""


def drawn(number: int) -> str:
    """A program."""
    chance = random.Random(f"tower {number}")  # noqa: S311 - no secret
    safe = round(chance.uniform(1.0, 2.6), 2)
    ttf = round(safe - chance.uniform(0.0, 0.25), 3)
    ttf_outer = round(chance.uniform(0.5 * safe, 2.9), 3)
    numbers = {
        "age": chance.choice([2, 5, 10]),
        "wind": round(chance.uniform(0.05, 0.3), 3),
        "error": round(chance.uniform(0.005, 0.03), 3),
        "lure": round(chance.uniform(0.5, 1.0) * ttf, 3),
        "sc_inner": chance.choice([5, 10]),
        "sc_outer": chance.choice([10, 20]),
        "dm_inner": chance.choice([10, 20, 40]),
        "dm_outer": chance.choice([20, 40, 60]),
        "late_inner": chance.choice([0, 1, 2]),
        "late_outer": chance.choice([0, 1, 2, 5]),
        "gain_inner": chance.choice([0.5, 1.0, 3.0]),
        "most_inner": round(chance.uniform(0.2, 1.0), 2),
        "gain_outer": chance.choice([1.0, 2.0, 5.0]),
        "safe_inner": safe,
        "ttf_inner": ttf,
        "safer_inner": round(ttf - chance.uniform(0.05, 0.5), 3),
        "ttf_outer": ttf_outer,
        "safer_outer": round(min(ttf_outer, safe * chance.uniform(0.6, 1.1)) - 0.02, 3),
    }
    return PROGRAM.format(**numbers)


def proofs(program: soter.Program) -> dict[str, bool]:
    """Whether each module is proved: a refusal is none."""
    proved = {}
    for name in CLAIMS:
        try:
            report = program.verify(module=name, refute=False)
            proved[name] = report.verdict in ("proved", "assumed")
        except SoterError:
            proved[name] = False
    return proved


def flown(program: soter.Program, tower: Tower, flights: int) -> None:
    """Every adversary in turn."""
    tower.violated = dict.fromkeys(CLAIMS, 0)
    for k in range(flights):
        run = program.simulate(seed=1000 * tower.number + k + 1, params={"KIND": k % KINDS})
        tower.flights += 1
        tower.given_back += run.modules["Outer"].switches_to_ac
        said = [v.what for v in run.violation_list]
        tower.violated["Inner"] += any("mode(Outer)" in what for what in said)
        tower.violated["Outer"] += any("mode(Outer)" not in what for what in said)


def main() -> int:
    """0 where no proved claim was violated."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("--towers", type=int, default=60)
    parser.add_argument("--flights", type=int, default=20)
    options = parser.parse_args()
    began, towers = time.perf_counter(), []
    with tempfile.TemporaryDirectory() as folder:
        for number in range(options.towers):
            path = Path(folder) / f"tower{number}.soter"
            path.write_text(drawn(number))
            program = soter.load(path)
            tower = Tower(number, proofs(program))
            flown(program, tower, options.flights)
            towers.append(tower)
    for name in CLAIMS:
        of = [(t, t.proved[name], t.violated[name]) for t in towers]
        held = [t for t, proved, _ in of if proved]
        bad = [t.number for t, proved, violated in of if proved and violated]
        bite = sum(1 for _, proved, violated in of if not proved and violated)
        flights = sum(t.flights for t in held)
        backs = sum(t.given_back for t in held)
        print(
            f"{name}: {len(held)} of {len(towers)} proved, flown {flights:,} times with {backs:,} "
            f"hand-backs, violated in {bad or 'none'}; of {len(towers) - len(held)} not proved "
            f"{bite} were violated"
        )
    print(f"{time.perf_counter() - began:.0f} s")
    return int(any(t.proved[n] and t.violated[n] for t in towers for n in CLAIMS))


if __name__ == "__main__":
    sys.exit(main())
