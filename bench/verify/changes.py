"""What `soter diff` says of drawn edits, beside what the provers are given before and after.

    .venv/bin/python bench/verify/changes.py [--edits 5] [--seed 1]

Purpose: in each of twelve programs `--edits` numbers, drawn from all that its text has, are changed
one at a time, until the program checks again. `soter diff` names the proofs that have to be done
again. That is compared with what the provers are given of both programs, made from nothing: the C
of a grid's enclosures, the functions of a tube, the steps of an induction, with all ranges, times
and assumptions. Counted are proofs that differ there and are not named, and proofs that are named
though everything there is the same to the byte.
Non-goals: whether a verdict changes; times, flights and tests.
"""

from __future__ import annotations

import argparse
import random
import re
import sys
from dataclasses import fields
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from soter.api.comparing import STANDS, compare
from soter.diagnostics.diagnostic import SoterError
from soter.language.elaborate.views_for_proofs import systems_by_view
from soter.language.front_end import check_file, system_to_prove
from soter.verify.enclose.compiled_enclosures import _safer_in_ac, generate_enclosures
from soter.verify.induction.problem import InductionProblem
from soter.verify.problem.extract import extract
from soter.verify.tubes.problem import TubeProblem, TubeTimes
from soter.verify.tubes.tube_check import TubeCheck

if TYPE_CHECKING:
    from soter.verify.problem.problem import Problem

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
PROGRAMS = (
    *("wall/cart", "rest/lane", "rest/cruise", "rest/bicycle", "rest/swerve", "robots/pendulum"),
    *("mountain_car/cliff", "drone/battery", "migration/geofence", "evidence/follow"),
    *("fleet/reservation_proof", "fleet/claims_proof"),
)
NUMBER = re.compile(r"(?<![\w.\"/])\d+(?:\.\d+)?(?=ms\b|us\b|s\b|deg\b|\b)")
TRIES = 200


def given(problem: Problem) -> str:
    """Everything that a prover computes from, as text."""
    plain = [
        f"{f.name} {getattr(problem, f.name)!r}"
        for f in fields(problem)
        if f.name in ("states", "initial", "controls", "disturbances", "errors", "others",
                      "parameters", "times", "levels", "topic_leaf_of_state", "assumptions",
                      "recover_ns", "within_ns", "plant_period_ns", "parameter_starts", "drifts")
    ]  # fmt: skip
    plain += [f"{axis!r}" for group in problem.groups for axis in group.axes]
    if isinstance(problem, TubeProblem):
        made = [
            TubeCheck(p).offline_text({}) + repr(TubeTimes.of_problem(p))
            for p in problem.plans or [problem]
        ]
    elif isinstance(problem, InductionProblem):
        steps = {i: n for i, n in problem.core.nodes.items() if i != problem.module.ac}
        made = [
            without_places(
                repr(
                    (
                        steps,
                        problem.core.functions,
                        problem.safe,
                        problem.lemmas,
                        problem.core.decisions,
                    )
                )
            )
        ]
    else:
        parts = problem.system, problem.core, problem.module, problem.quantities
        made = [generate_enclosures(*parts, _safer_in_ac(problem)).source]
    law = problem.law_unread if problem.law is None else given(problem.law)
    return "\n".join([*plain, *made, law])


def without_places(text: str) -> str:
    """A text without where in a file its parts stand."""
    return re.sub(r"Span\([^()]*(?:\([^()]*\)[^()]*)*\)", "", text)


def all_given(path: Path) -> dict[str, str]:
    """What provers are given of each module that is proved, by `module in system`."""
    checked, found = check_file(str(path)), {}
    for system in checked.systems:
        if checked.systems[system].deploys is not None:
            continue
        flat = system_to_prove(checked, system, {}, exact=False)
        for module in flat.modules:
            if module.forced is not None:
                continue
            try:
                texts = [given(extract(*seen)) for seen in systems_by_view(flat, module)]
            except SoterError:
                continue  # nothing is proved of it
            found[f"{module.name} in {system}"] = "\n".join(texts)
    return found


def edits(text: str, draw: random.Random) -> list[str]:
    """The program with one number changed, for each of its numbers, in drawn order."""
    code = re.sub(r"//[^\n]*", lambda c: " " * len(c[0]), text)
    places = [m for m in NUMBER.finditer(code) if m.start() > text.index(";")]
    draw.shuffle(places)
    changed = []
    for m in places[:TRIES]:
        value = f"{float(m[0]) * 1.01:.6g}" if "." in m[0] else str(int(m[0]) + 1)
        changed.append(text[: m.start()] + value + text[m.end() :])
    return changed


def main() -> int:
    """A row a program; 1 where a proof that differs was not named, or too many others were."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--edits", type=int, default=5)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    total = [0, 0, 0, 0]
    print(
        f"{'program':24}{'edits':>6}{'proofs differ':>15}{'not named':>11}{'stand':>7}{'named':>7}"
    )
    for name in PROGRAMS:
        path, draw = EXAMPLES / f"{name}.soter", random.Random(f"{args.seed} {name}")  # noqa: S311 - a sample
        before, row, done = all_given(path), [0, 0, 0, 0], 0
        for text in edits(path.read_text(encoding="utf-8"), draw):
            if done == args.edits:
                break
            with TemporaryDirectory(dir=path.parent) as folder:
                new = Path(folder).with_name(f"{Path(folder).name}.soter")
                new.write_text(text, encoding="utf-8")
                try:
                    if not check_file(str(new)).ok:
                        continue
                    found, after = compare(path, new), all_given(new)
                finally:
                    new.unlink()
            done += 1
            named = {c.name for c in found.consequences if c.what == "proof" and c.status != STANDS}
            for key, told in {**dict.fromkeys(before), **after}.items():
                differs = before.get(key) != told
                row[0 if differs else 2] += 1
                row[1 if differs else 3] += differs != (key in named)
        print(f"{name:24}{done:6}{row[0]:15}{row[1]:11}{row[2]:7}{row[3]:7}", flush=True)
        total = [a + b for a, b in zip(total, row, strict=True)]
    share = total[3] / max(1, total[2])
    print(f"\n{total[0]} proofs differ, {total[1]} of them not named (target: 0)")
    print(f"{total[2]} proofs stand, {total[3]} of them named: {share:.0%} (target: <= 20 %)")
    return 1 if total[1] or share > 0.2 else 0


if __name__ == "__main__":
    sys.exit(main())
