"""Programs whose rest is wrong: too large, it drifts farther, no time for it, SC that leads away.

    python bench/tubes/wrong_rests.py --count 80

Purpose: `drawn`, a change of one number or sign of a right program, which is wrong for a reason
that is written beside it; `proved`, whether row P2a is.
Non-goals: changes of the check itself (`smaller_constants.py`).
"""

from __future__ import annotations

import argparse
import random
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from soter.diagnostics.diagnostic import SoterError  # noqa: E402
from soter.language.front_end import check_file, system_to_prove  # noqa: E402
from soter.verify.problem.extract import extract  # noqa: E402
from soter.verify.tubes.rest_claims import show_rest_claims  # noqa: E402
from soter.verify.tubes.tube_check import TubeCheck  # noqa: E402

FOLLOW = (ROOT / "examples" / "evidence" / "follow.soter").read_text(encoding="utf-8")
HELD = """soter 1;
topic seen: float in [-2.0, 2.0] max_age 20ms;
topic push: float in [-1.0, 1.0] = 0.0;
node Ac period 20ms { publishes push; step { publish push = 1.0; } }
node Sc period 20ms { subscribes seen; publishes push;
  step { publish push = clamp(-3.0 * seen, -1.0, 1.0); } }
rta Held { ac Ac; sc Sc; period 20ms; safe abs(seen) < 1.0; rest abs(seen) < 0.3 within 2s; }
plant Speed period 10ms { reads push; drives seen = v; state v: float = 0.0;
  disturbance wind: float in [-0.2, 0.2]; der v = push + wind; measured seen within 0.02; }
system S default { p: Speed; module Held; until 1s; }
"""
LEVERS = "gas: 0.0, brake: 1.0 }; }"
LAW = "clamp(-3.0 * seen, -1.0, 1.0)"
WRONG = (
    # a train that rolls at 0.3 m/s goes 0.3 / BRAKE = 0.15 m further
    ("it drifts farther", FOLLOW, "CREEP: float = 0.3", "CREEP: float = {}", 0.01, 0.149),
    ("rest is too large", FOLLOW, "abs(sight.v) < 0.3", "abs(sight.v) < {}", 0.61, 30.0),
    ("the brake is weak", FOLLOW, "BRAKE: float = 2.0", "BRAKE: float = {}", 0.05, 0.99),
    ("SC brakes too little", FOLLOW, LEVERS, "gas: 0.0, brake: {} }}; }}", 0.0, 0.49),
    ("SC leaves some gas", FOLLOW, LEVERS, "gas: {}, brake: 1.0 }}; }}", 0.32, 1.0),
    (
        "who is in front backs",
        FOLLOW,
        "float in [0.0, 30.0] hold",
        "float in [-{}, 30.0] hold",
        0.01,
        5.0,
    ),
    ("no time", FOLLOW, "within 5s", "within {:.0f}ms", 1, 49),
    ("SC pushes the wrong way", HELD, LAW, "clamp({} * seen, -1.0, 1.0)", 0.1, 9.0),
    ("SC looks elsewhere", HELD, LAW, "clamp(-3.0 * (seen - {}), -1.0, 1.0)", 0.32, 1.9),
    ("SC is too weak for the wind", HELD, LAW, "clamp(-{} * seen, -1.0, 1.0)", 0.0, 0.6),
    ("the wind is too strong", HELD, "float in [-0.2, 0.2]", "float in [-{0}, {0}]", 1.05, 3.0),
    ("rest is too small", HELD, "abs(seen) < 0.3", "abs(seen) < {}", 0.005, 0.085),
)
"""What is wrong, of which program, by which change, with numbers from and to."""


def drawn(number: int) -> tuple[str, str]:
    """What is wrong, and the program."""
    r = random.Random(number)  # noqa: S311 - drawn examples
    why, text, old, new, low, high = WRONG[number % len(WRONG)]
    assert text.count(old) == 1, old
    value = round(r.uniform(low, high), 0 if isinstance(low, int) else 4)
    return why, text.replace(old, new.format(value))


def proved(text: str) -> bool:
    """Whether P2a is, of a program's module; a diagnostic is no proof."""
    try:
        flat = system_to_prove(check_file("wrong.soter", text), None)
        check = TubeCheck(extract(flat, flat.modules[0]))  # type: ignore[arg-type]
        claims = show_rest_claims(check)
    except SoterError:
        return False
    return not (claims.kept or claims.moves)


def main(argv: list[str]) -> int:
    """0; 3 where one is proved, or one of the right programs is not."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=80)
    count = parser.parse_args(argv).count
    right = [proved(text) for text in (FOLLOW, HELD)]
    wrong = 0
    for number in range(count):
        why, text = drawn(number)
        if proved(text):
            wrong += 1
            print(f"PROVED: variant {number}, {why}")
    print(f"{wrong} of {count} wrong variants proved; {sum(right)} of {len(right)} right ones")
    return 0 if all(right) and not wrong else 3


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
