"""Six wrong variants of each robot of a folder: none may be proved in full.

    .venv/bin/python bench/newcomers/wrong_robots.py [--folder ../shared/robots]
        [--simulate] [--kept .soter/newcomers] [NAME ...]

Purpose: a variant changes one thing of a robot's program: SC, an error, a disturbance, a time, a
set, an equation. That it is wrong is shown first, by `flights.py`, which knows nothing of Soter:
from *every* state of a lattice of `safe` some flight of SC, or of AC until the DM may act and SC
then, leaves `safe`; of a variant with sets of its own, from some state that leaves AC in control.
Then `soter verify` is asked, which may find a run that violates as well. `--simulate`: only the
first half. Answers are kept, by program and the tool's sources: the next call goes on.
Non-goals: the robots as they stand (`first_attempt.py`); other wrong modules
(`bench/wrong_modules`).
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from functools import partial
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
if str(ROOT) not in sys.path:
    sys.path.insert(0, str(ROOT))

from bench.newcomers.equations import robot_of  # noqa: E402 - needs the path
from bench.newcomers.first_attempt import answered, kept, tool  # noqa: E402
from bench.newcomers.flights import leaves  # noqa: E402
from bench.newcomers.wrong_variants import FLOWN_S, STARTS, VARIANTS, Wrong  # noqa: E402

NOTHING = Wrong("nothing", {})


def edited(text: str, wrong: Wrong) -> str:
    """The program of a variant; every edit must fit, once or more often."""
    for old, new in wrong.edits.items():
        assert old in text, (wrong.why, old)
        text = text.replace(old, new)
    return text


def flown(name: str, text: str, wrong: Wrong) -> dict[str, int]:
    """From how many starts a program leaves `safe`, of how many."""
    ends = {**STARTS.get(name, {}), **wrong.left}
    robot = robot_of(text, wrong.until_s or FLOWN_S[name], ends)
    left, starts = leaves(robot, own_sets=bool(wrong.left))
    return {"left": left, "starts": starts}


def main(argv: list[str]) -> int:
    """0; 3 where one is proved, or a variant is not shown to be wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--folder", type=Path, default=ROOT.parent / "shared" / "robots")
    parser.add_argument("--simulate", action="store_true")
    parser.add_argument("--kept", type=Path, default=ROOT / ".soter" / "newcomers")
    parser.add_argument("names", nargs="*")
    options = parser.parse_args(argv)
    names = options.names or list(VARIANTS)
    shown, flies, answers = 0, 0, Counter[str]()
    flights = "".join((HERE / f"{name}.py").read_text() for name in ("equations", "flights"))
    print("| robot | what is wrong | starts that leave `safe` | `soter verify` | CPU s |")
    print("|---|---|---|---|---|")
    for name in names:
        right = (options.folder / f"{name}.soter").read_text()
        for wrong in (NOTHING, *VARIANTS[name]):
            text = edited(right, wrong)
            about = (text, flights, f"{FLOWN_S[name]} {STARTS.get(name)} {wrong}")
            of = kept(options.kept, about, partial(flown, name, text, wrong))
            row = f"| {name} | {wrong.why} | {of['left']} of {of['starts']}"
            if wrong is NOTHING:
                flies += of["left"] < of["starts"]
                print(f"{row} | - | - |", flush=True)
                continue
            is_wrong = of["left"] >= (1 if wrong.left else of["starts"])
            shown += is_wrong
            row += " |" if is_wrong else ": NOT SHOWN |"
            answer: dict[str, Any] = {"verdict": "-", "cpu_s": 0.0}
            if not options.simulate:
                about = (name, text, tool())
                answer = kept(options.kept, about, partial(answered, name, text, 0.0))
            answers[answer["verdict"].partition(":")[0]] += 1
            print(f"{row} {answer['verdict']} | {answer['cpu_s']:.0f} |", flush=True)
    count, proved = answers.total(), answers["proved"]
    told = ", ".join(f"{answers[answer]} {answer}" for answer in sorted(answers))
    print(f"\n{proved} of {count} wrong variants proved ({told})")
    print(f"{shown} of {count} shown to be wrong, {flies} of {len(names)} right robots fly")
    return 0 if not proved and shown == count and flies == len(names) else 3


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
