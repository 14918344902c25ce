"""Six wrong variants of each robot of a folder: none may be proved in full.

    .venv/bin/python bench/newcomers/wrong_robots.py [--folder ../shared/robots]
        [--kept .soter/newcomers] [NAME ...]

Purpose: a variant changes one thing of a robot's program: SC, an error, a disturbance, a time, a
set, an equation. That it is wrong is shown first, by flights that know nothing of Soter:
from *every* state of a lattice of `safe` some flight of SC, or of AC until the DM may act and SC
then, leaves `safe`; of a variant with sets of its own, from some state that leaves AC in control.
Then the proof of `soter verify` is asked, without its advice and without its search for a run that
violates. Answers are kept, by program and the tool's sources: the next call goes on.
Non-goals: the robots as they stand (`first_attempt.py`); other wrong modules
(`bench/wrong_modules`).
"""

from __future__ import annotations

import argparse
import resource
import sys
import tempfile
from collections import Counter
from functools import partial
from pathlib import Path
from typing import Any

import soter
from soter.diagnostics.diagnostic import SoterError
from soter.verify.claims.results import UNDECIDED

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
sys.path.insert(0, str(ROOT))

from bench.newcomers.equations import robot_of  # noqa: E402 - needs the path
from bench.newcomers.first_attempt import kept, tool  # noqa: E402
from bench.newcomers.flights_in_c import leaves  # noqa: E402
from bench.newcomers.wrong_variants import (  # noqa: E402
    FLOWN_S,
    RIGHT,
    STARTS,
    VARIANTS,
    Wrong,
)

NOTHING = Wrong("nothing", {})
READERS = "equations", "flights", "flights_in_c"


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


def answered(name: str, text: str) -> dict[str, Any]:
    """What `verify` says of a program, and its CPU seconds."""
    began = cpu_now_s()
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / f"{name}.soter"
        program.write_text(text)
        try:
            (module,) = soter.load(program).verify(refute=False, explain=False).modules
        except SoterError as error:
            return {"verdict": f"error {error.diagnostics[0].code}", "cpu_s": cpu_now_s() - began}
    open_ = [claim for claim, f in module.findings.items() if f.verdict == UNDECIDED]
    undecided = f"undecided: {', '.join(open_)}"
    verdict = undecided if module.verdict == UNDECIDED else module.verdict
    return {"verdict": verdict, "cpu_s": cpu_now_s() - began}


def cpu_now_s() -> float:
    """CPU seconds of this process and of the compilers that it started."""
    uses = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(use.ru_utime + use.ru_stime for use in uses)


def flights_of(folder: Path, name: str, text: str, wrong: Wrong) -> dict[str, Any]:
    """How it flies."""
    reader = "".join((HERE / f"{file}.py").read_text() for file in READERS)
    about = text, reader, f"{FLOWN_S[name]} {STARTS.get(name)} {wrong}"
    return kept(folder, about, partial(flown, name, text, wrong))


def main(argv: list[str]) -> int:
    """0; 3 where one is proved, or flights show something else."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--folder", type=Path, default=ROOT.parent / "shared" / "robots")
    parser.add_argument("--kept", type=Path, default=ROOT / ".soter" / "newcomers")
    parser.add_argument("names", nargs="*")
    options = parser.parse_args(argv)
    names = options.names or list(VARIANTS)
    told = Counter[str]()
    print("| robot | what is wrong | starts that leave `safe` | `soter verify` | CPU s |")
    print("|---|---|---|---|---|")
    for name in names:
        stands, nothing = (options.folder / f"{name}.soter").read_text(), RIGHT.get(name, NOTHING)
        for wrong in (nothing, *VARIANTS[name]):
            text = edited(stands, nothing)
            text = text if wrong is nothing else edited(text, wrong)
            of = flights_of(options.kept, name, text, wrong)
            leaving, verdict, cpu_s = f"{of['left']} of {of['starts']}", "-", "-"
            told["right robots fly"] += wrong is nothing and of["left"] < of["starts"]
            shown = of["left"] >= (1 if wrong.left else of["starts"])
            told["shown to be wrong"] += wrong is not nothing and shown
            told["flown and not so"] += shown == (wrong is nothing)
            if wrong is not nothing:
                asked = name, text, tool()
                answer = kept(options.kept, asked, partial(answered, name, text))
                verdict, cpu_s = answer["verdict"], f"{answer['cpu_s']:.0f}"
                told[verdict.partition(":")[0]] += 1
                told["asked"] += 1
            print(f"| {name} | {wrong.why} | {leaving} | {verdict} | {cpu_s} |", flush=True)
    count = sum(len(VARIANTS[name]) for name in names)
    print(
        f"\n{told['proved']} of {told['asked']} wrong variants proved, {told['refuted']} refuted, "
        f"{count - told['asked']} not asked yet; {told['shown to be wrong']} of {count} shown to "
        f"be wrong; {told['right robots fly']} of {len(names)} right robots fly"
    )
    return 3 if told["proved"] or told["flown and not so"] else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
