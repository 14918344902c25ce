"""What it costs until `soter verify` says that it does not know.

    .venv/bin/python bench/verify/undecided_costs.py [--systems 44] [--from 0] [--robots]
        [--folder ../shared/robots] [NAME ...]

- Polytopes: masses and springs at random, lightly damped, perhaps behind a lag, with long holds of
  SC, a row a kind of answer; the longest without a proof is to take 20 s of CPU at most.
- Robots, with `--robots`: those of a folder that are undecided, and wrong variants
  (`bench/newcomers/wrong_variants.py`) of some that are proved. An answer is to take 20 s at most,
  or three times what the proof of the right robot takes. `NAME`: only these.

CPU seconds are of the process and its children; the engine is compiled before.
Purpose: both rows of what an undecided run costs, by one command.
Non-goals: whether a verdict is right (`soundness.py`, `bench/newcomers/wrong_robots.py`).
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path
from random import Random

ROOT = Path(__file__).resolve().parents[2]
if str(ROOT) not in sys.path:
    sys.path.insert(0, str(ROOT))

from bench.newcomers.first_attempt import run, said  # noqa: E402 - needs the path
from bench.newcomers.wrong_robots import edited  # noqa: E402
from bench.newcomers.wrong_variants import VARIANTS  # noqa: E402

from soter.report.terminal_tables import table  # noqa: E402

MOST_S, TIMES = 20.0, 3.0
UNDECIDED = (
    "cruise_control",
    "differential_drive",
    "dubins_uav",
    "ground_avoidance",
    "motor",
    "pendulum",
)
MADE_WRONG = ("car_on_a_lane", "hopper", "emergency_brake", "oven")
"""Of each of these, which are proved, the first two wrong variants."""
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


def verdict(name: str, text: str) -> tuple[str, float]:
    """What `soter verify` says of a program, and its CPU seconds."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / f"{name}.soter").write_text(text)
        document, cpu_s = run("verify", f"{name}.soter", folder=Path(folder))
    return said(document), cpu_s


def polytopes(first: int, count: int) -> bool:
    """Whether all answers without a proof came in time; the systems `first` and those after it."""
    answers: dict[str, list[float]] = {}
    longest = 0.0
    for number in range(first, first + count):
        said_, cpu_s = verdict("masses", program_of(number))
        answers.setdefault(said_, []).append(cpu_s)
        longest = longest if said_ == "proved" else max(longest, cpu_s)
    rows = [
        (kind, len(all_s), f"{sum(all_s) / len(all_s):.1f}", f"{max(all_s):.1f}")
        for kind, all_s in sorted(answers.items(), key=lambda x: -len(x[1]))
    ]
    print(table(("polytopes of linear systems", "systems", "mean CPU s", "longest"), rows))
    late = sum(s > MOST_S for kind, all_s in answers.items() if kind != "proved" for s in all_s)
    print(f"\nlongest without a proof: {longest:.1f} s of {MOST_S:.0f}; over that: {late}\n")
    return late == 0


def robots(folder: Path, names: list[str]) -> bool:
    """Whether all answers of robots that are not proved came in time."""
    asked: list[tuple[str, str, str, float]] = []
    proofs: dict[str, float] = {}
    for name in (*UNDECIDED, *MADE_WRONG):
        if names and name not in names:
            continue
        text = (folder / f"{name}.soter").read_text()
        if name in UNDECIDED:
            asked.append((name, "", *verdict(name, text)))
            continue
        right, cpu_s = verdict(name, text)
        if right == "proved":
            proofs[name] = cpu_s
        wrong = VARIANTS[name][:2]
        asked += [(name, v.why, *verdict(name, edited(text, v))) for v in wrong]
    rows, late = [], 0
    for name, why, answer, cpu_s in asked:
        bar = max(MOST_S, TIMES * proofs.get(name, 0.0))
        over = cpu_s > bar and answer != "proved"
        late += over
        proof = f"{proofs[name]:.0f}" if name in proofs else "-"
        rows.append((name, why, answer, f"{cpu_s:.0f}", proof, "over" if over else "yes"))
    print(table(("robot", "what is wrong", "verdict", "CPU s", "its proof", "in time"), rows))
    print(f"\n{len(rows) - late} of {len(rows)} answers in time")
    return late == 0


def main(argv: list[str]) -> int:
    """0; 3 where an answer came late."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--systems", type=int, default=44)
    parser.add_argument("--from", type=int, default=0, dest="first")
    parser.add_argument("--robots", action="store_true")
    parser.add_argument("--folder", type=Path, default=ROOT.parent / "shared" / "robots")
    parser.add_argument("names", nargs="*")
    options = parser.parse_args(argv)
    verdict("warm", program_of(0))
    in_time = polytopes(options.first, options.systems) if options.systems else True
    if options.robots:
        in_time = robots(options.folder, options.names) and in_time
    return 0 if in_time else 3


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
