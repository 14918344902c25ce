"""What a shield is worth: the share of SC with the state alone and with commands judged, too.

    .venv/bin/python bench/adversary/shield.py [--flights N] [--threads N]

Carts, an arm, a multicopter and a docking craft, each under an AC that goes as near and brakes as
late as it dares, one that pushes at the border, one that changes its mind at every release; the
same module with `shield` left out, with `shield 8` and with `shield 8 toward sc`; of the last also
what share of AC's commands was moved while it had control. Then how long a step of AC takes in C
without a judgement, with one, and below `toward sc` where the command stays and where it is moved.
Exit code 1 where a flight left `safe`.

Purpose: the table of docs/benchmarks.md. Non-goals: times and errors at their bounds (disturbances
and errors are drawn from their sets; `against_proofs.py` puts them at their ends).
"""

from __future__ import annotations

import argparse
import re
import struct
import sys
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import soter
from soter.codegen.unit import generate
from soter.core.steps import lower
from soter.language.front_end import check_file, system_of
from soter.native.shared_library import interface, library, opened
from soter.verify.deploy.missing_predicates import complete

ROOT = Path(__file__).resolve().parents[2]
NOW_NS = 10**9
STEPS = 2_000_000
ROUNDS = 5
CALLS = """
double soter_steps(void *state, unsigned component, unsigned long count);
double soter_steps(void *state, unsigned component, unsigned long count) {{
  double faults = 0.0;
  uint32_t published = 0;
  for (unsigned long k = 0; k < count; k++) {{
    faults += {prefix}_program.component[component].step(state, SOTER_ENABLED, &published, NULL);
  }}
  return faults;
}}
void soter_begin(void *state);
void soter_begin(void *state) {{ {prefix}_program.init(state, 1U); }}
"""


@dataclass(frozen=True)
class Model:
    """A program; the node that is its AC and what it publishes; its module; commands of AC."""

    name: str
    path: str
    node: str
    module: str
    system: str
    late: tuple[str, ...]
    """Steps of an AC that brakes late, and of one that goes too near."""
    output: str
    greatest: str
    seconds: int
    middle: tuple[str, float]
    """A topic and its first number, where all is permitted."""


GOAL = "(floor(time / 10.0) - 2.0 * floor(time / 20.0) < 0.5 ? {0} : -{0})"
HEIGHT = "let to = 35.0 + {to}; publish command = clamp(2.0 * (to - flight.height), -CLIMB, CLIMB);"
STOP = """let left = Goal(time) - craft.x;
    let fast = sign(left) * sqrt({late} * abs(left));
    publish push = clamp(5.0 * (fast - craft.v), -PUSH, PUSH);"""
MODELS = (
    Model(
        "cart",
        "examples/wall/shield.soter",
        "Driver",
        "Shielded",
        "Track",
        ("",),
        "accel",
        "A",
        60,
        ("motion", 0.0),
    ),
    Model(
        "pendulum",
        "examples/generality/pendulum.soter",
        "Lean",
        "SafeArm",
        "Protected",
        (
            "let to = " + GOAL.format("0.6") + "; publish torque = clamp(60.0 * (to - arm.angle) "
            "- 14.0 * arm.rate - PULL * sin(arm.angle), -TORQUE, TORQUE);",
        ),
        "torque",
        "TORQUE",
        60,
        ("arm", 0.0),
    ),
    Model(
        "altitude",
        "examples/generality/altitude.soter",
        "Operator",
        "SafeAltitude",
        "Protected",
        tuple(HEIGHT.format(to=GOAL.format(up)) for up in ("23.2", "24.2")),
        "command",
        "CLIMB",
        120,
        ("flight", 35.0),
    ),
    Model(
        "docking 1-D",
        "bench/adversary/docking.soter",
        "Pilot",
        "Docking",
        "Loop",
        tuple(STOP.format(late=late) for late in ("1.2", "1.4")),
        "push",
        "PUSH",
        60,
        ("craft", -5.0),
    ),
)


SHIELDS = ("", "shield 8;", "shield 8 toward sc;")


def text_of(model: Model, step: str, shield: str) -> str:
    """The program with this step of AC, its module with this clause."""
    text = (ROOT / model.path).read_text("utf-8")
    if step:
        head, node, rest = text.partition(f"node {model.node} ")
        rest = re.sub(
            r"step \{.*?\n  \}", lambda _: f"step {{ {step} }}", rest, count=1, flags=re.DOTALL
        )
        text = head + node + rest
    head, node, rest = text.partition(f"rta {model.module} {{")
    rest = re.sub(r"\n  shield 8;", "", rest, count=1)
    return head + node + rest.replace("verify {", f"{shield}\n  verify {{", 1)


def steps_of(model: Model) -> dict[str, str]:
    """Steps of AC: its name and its text."""
    end, out = model.greatest, model.output
    return {
        **dict(zip(("near-optimal", "nearer"), model.late, strict=False)),
        "pushes": f"publish {out} = {end};",
        "to and fro": f"publish {out} = sin(131.0 * time) > 0.0 ? {end} : -{end};",
    }


def flown(path: Path, model: Model, flights: int, threads: int) -> tuple[float, float, int]:
    """The share of SC, switches to it a second, flights that left `safe`."""
    program = soter.load(path)
    with tempfile.TemporaryDirectory() as folder:
        campaign = program.campaign(
            model.system,
            flights=flights,
            until=f"{model.seconds}s",
            workers=threads,
            output=Path(folder) / "campaign",
        )
    module = next(m for m in campaign.result.modules if m.name == model.module)
    seconds = flights * model.seconds
    return 1.0 - module.ac_share, module.disengagements / seconds, campaign.result.flights_violated


def moved_share(path: Path, model: Model) -> float:
    """What share of AC's commands was moved while it had control, in one run."""
    program = soter.load(path)
    run = program.simulate(system=model.system, seed=1, until=f"{model.seconds}s", trace=False)
    module = next(m for m in run.system.modules if m.name == model.module)
    published, moved = run.moved_commands[module.index]
    return moved / max(published, 1)


def step_ns(path: Path, model: Model, *, moved: bool = False) -> float:
    """A step of AC in C, in control and with fresh readings; the least of some rounds.

    `moved`: nearest to the middle where the command is moved and not refused.
    """
    flat = system_of(check_file(str(path)), model.system)
    complete(flat)
    unit = generate(flat, lower(flat))
    source = unit.source + CALLS.format(prefix=unit.prefix)
    ffi = interface(
        "double soter_steps(void *state, unsigned component, unsigned long count);"
        "void soter_begin(void *state);"
    )
    lib = opened(ffi, library(replace(unit, source=source)))
    module = next(m for m in flat.modules if m.name == model.module)
    state, ac = bytearray(unit.layout.size), module.ac
    offset = {t.name: unit.layout.topic_offset(t.index) for t in flat.topics}
    for way in (0.0, *np.geomspace(1e-3, 50.0, 3000)) if moved else (0.0,):
        lib.soter_begin(ffi.from_buffer(state))
        struct.pack_into("<q", state, 0, NOW_NS)
        for i in range(len(flat.topics)):
            struct.pack_into("<q", state, unit.layout.stamp_offset + 8 * i, NOW_NS)
        struct.pack_into("<d", state, offset[model.middle[0]], model.middle[1] + way)
        faults = lib.soter_steps(ffi.from_buffer(state), ac, 2)
        if not moved:
            break
        told, proposed = (
            struct.unpack_from("<d", state, offset[name])[0]
            for name in (flat.topics[module.outputs[0]].name, f"{module.name}.proposed")
        )
        if faults == 0.0 and told != proposed:
            break
    else:
        raise AssertionError("no command is moved")
    least = float("inf")
    for _ in range(ROUNDS):
        began = time.perf_counter()
        faults = lib.soter_steps(ffi.from_buffer(state), ac, STEPS)
        least = min(least, time.perf_counter() - began)
        assert faults == 0.0, "a command was refused where all is permitted"
    return least / STEPS * 1e9


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--flights", type=int, default=1000)
    parser.add_argument("--threads", type=int, default=1)
    said = parser.parse_args()
    lost = 0
    print(f"{said.flights:,} flights each")
    print(
        "| module | AC | SC, state alone | shield | toward sc | removed | toward sc | switches/s "
        "| shield | toward sc | moved | left safe |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "flown.soter"
        for model in MODELS:
            for name, step in steps_of(model).items():
                row = []
                for shield in SHIELDS:
                    path.write_text(text_of(model, step, shield), "utf-8")
                    row.append(flown(path, model, said.flights, said.threads))
                shares, switches, left = zip(*row, strict=True)
                lost += sum(left)
                alone, *others = shares
                removed = [f"{1.0 - x / alone:.0%}" if alone else "-" for x in others]
                cells = [*(f"{x:.2%}" for x in shares), *removed, *(f"{x:.3f}" for x in switches)]
                cells += [f"{moved_share(path, model):.0%}", " + ".join(map(str, left))]
                print(f"| {model.name} | {name} | {' | '.join(cells)} |", flush=True)
        for model in MODELS:
            took = []
            for shield in SHIELDS:
                path.write_text(text_of(model, f"publish {model.output} = 0.0;", shield), "utf-8")
                took.append(f"{step_ns(path, model):.0f}")
            step = f"publish {model.output} = {model.greatest};"
            path.write_text(text_of(model, step, SHIELDS[-1]), "utf-8")
            took.append(f"{step_ns(path, model, moved=True):.0f}")
            print(f"{model.name}: a step of AC, ns: {', '.join(took)}")
    return 1 if lost else 0


if __name__ == "__main__":
    sys.exit(main())
