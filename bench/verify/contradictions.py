"""Whether `soter verify`, `soter recheck` and `soter run` contradict each other, on random modules.

    .venv/bin/python bench/verify/contradictions.py [--modules N] [--stiff N] [--seed N] [--seconds]

Purpose: modules on grids, inductions, instances, dials that nobody reads, jitter that
stands alone, control arms, and groups that no command moves under schemes that may diverge. Each is
verified with a certificate, rechecked, and run: by `soter run` for several seeds, and with an AC,
disturbances and errors at their bounds in seeded patterns. Contradictions: *proved, rejected*, but
where it is not re-checked and `verify` has said so in its headline (each reason is counted);
*accepted, not proved*; *proved, violated*: `safe` of the true state is left; *proved, stops*: a
plant latches; *another system*: than the default one, which forces the module, is judged. A
violation where the headline says that the scheme is assumed is `assumed`, and no contradiction.
A program is had again from its number (`program`). Exit code 1 where there is one.
Non-goals: what nothing proves, or only one of them knows (`soundness.py`, `bench/recheck`).
"""

from __future__ import annotations

import argparse
import random
import re
import signal
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

ROOT = Path(__file__).resolve().parents[2]
sys.path += [str(ROOT), str(ROOT / "tests")]

from bench.adversary.module_families import module  # noqa: E402 - as above

from generators.induction_planners import planner  # noqa: E402 - as above
from soter.api import load, recheck  # noqa: E402 - needs the path
from soter.diagnostics.diagnostic import SoterError  # noqa: E402 - needs the path
from soter.language.front_end import check_file, system_to_prove  # noqa: E402 - needs the path
from soter.semantics.adverse_draws import CHANCE, CORNER, HOLDS, TURN  # noqa: E402 - needs the path
from soter.verify import refute as attacks  # noqa: E402 - needs the path
from soter.verify.attacked_system import DRAWN, NotAttackableError  # noqa: E402 - needs the path
from soter.verify.deploy.missing_predicates import complete  # noqa: E402 - needs the path

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.certificate.report import Report as RecheckReport
    from soter.verify.claims.results import VerifyReport

RUNS, ATTACKS, PERIODS = 5, 24, 400
"""Seeds of `soter run`, of every hostile pattern, and DM periods that one of these lasts."""
ANNOUNCED = "not re-checked, as verify says"
SCHEME = "scheme"
"""What a headline names as assumed where the scheme that runs is not in the proof."""
CONTROL = "system Control default"
KINDS = (
    "proved, rejected",
    "accepted, not proved",
    "proved, violated",
    "proved, stops",
    "another system",
)


@dataclass(frozen=True)
class Found:
    """What became of one program: the verdicts, and the contradictions with what shows them."""

    verdict: str
    rechecked: str
    contradictions: tuple[tuple[str, str], ...] = ()
    excused: str = ""


class TooLongError(BaseException):
    """The time of one module is over. The re-checker reports any `Exception` in it, not this."""


# ---------------------------------------------------------------- programs


def program(number: int, *, stiff: bool) -> tuple[str, str]:
    """Kind and text of a random program."""
    rng = random.Random(f"{number} {stiff}")  # noqa: S311 - test programs
    if not stiff and number % 5 == 4:
        return "induction", _induction(number, rng)
    text = _cart(rng) if stiff or rng.random() < 0.6 else module(number).text
    if "plant P" not in text or "der " not in text or "abstracts" in text or "p: P;" not in text:
        return "module", text
    if stiff:
        text = _with_fast_state(text, rng)
    if rng.random() < (0.2 if stiff else 0.4):
        scale, bound = rng.choice((1.0, 10.0)), rng.choice((0.3, 0.6, 5.0))
        text = text.replace("  state x0", f"  drives dial = {scale!r} * x0;\n  state x0", 1)
        text = text.replace("plant P", f"topic dial: float in [-{bound}, {bound}];\nplant P", 1)
    if rng.random() < 0.05:
        text = re.sub(r"(node Sc period \w+[^{]*\{)", r"\1 jitter 2ms;", text)
    kind = "stiff" if stiff else "grid"
    if rng.random() < 0.2:
        return f"{kind}, instances", _instances(text, rng)
    return kind, text


def _cart(rng: random.Random) -> str:
    """One state that SC brings back, most often provable."""
    plant, many = rng.choice((2000, 5000, 10_000)), rng.choice((1, 2))
    force, wind = rng.choice((1.0, 2.0)), rng.choice((0.0, 0.05, 0.2))
    error = rng.choice((0.0, 0.01))
    written = rng.choice(("", "\n  ttf abs(y) > 0.5;\n  safer abs(y) < 0.35;"))
    extras = rng.choice(("", "recover never; ", "levels 2; "))
    return f"""soter 1;
topic y: float max_age {2 * plant}us;
topic u0: float in [-{force}, {force}] = 0.0;
plant P period {plant}us {{
  reads u0;
  drives y = x0;
  state x0: float = 0.0;
  disturbance w0: float in [-{wind}, {wind}];
  der x0 = u0 + w0;
  measured y within {error};
}}
node Ac period 20000us {{ publishes u0; step {{ publish u0 = {rng.choice((-force, force))}; }} }}
node Sc period {10_000 * many}us {{
  subscribes y; publishes u0;
  step {{ publish u0 = clamp(-{rng.choice((2.0, 4.0))} * y, -{force}, {force}); }}
}}
rta M {{
  ac Ac; sc Sc; period 20000us;
  safe abs(y) < 1.0;{written}
  verify {{
    {extras}grid y in [-1.1, 1.1] / {rng.choice((88, 220))};
  }}
}}
system S {{ p: P; module M; until 10s; }}
"""


def _with_fast_state(text: str, rng: random.Random) -> str:
    """A state z that nothing moves but itself and what disturbs it, fast or not."""
    match = re.search(r"plant P period (\d+)us", text)
    assert match is not None
    rate = rng.choice((0.2, 0.6, 0.9, 1.5, 2.5, 4.0, 10.0)) / (int(match[1]) * 1e-6)
    pulled = rng.random() < 0.5
    der = f"{rate:.6g} * (dz - z)" if pulled else f"-{rate:.6g} * z"
    more = f"  state z: float = {rng.choice((0.0, 0.3, -0.9))};\n  der z = {der};\n"
    more += "  disturbance dz: float in [-0.5, 0.5];\n" if pulled else ""
    more += "  integrate euler;\n" if rng.random() < 0.3 else ""
    text = text.replace("  state x0", f"  drives zs = z;\n{more}  state x0", 1)
    text = text.replace("plant P", "topic zs: float;\nplant P", 1)
    text = text.replace(
        "  verify {\n", f"  verify {{\n    grid p.z in [-1.0, 1.0] / {rng.choice((1, 1, 20))};\n"
    )
    if rng.random() < 0.5:
        text = re.sub(r"  safe (.*);\n", r"  safe \1 && abs(zs) <= 1.0;\n", text)
    return text


def _instances(text: str, rng: random.Random) -> str:
    """Two robots; sometimes the default system forces one of them."""
    text = re.sub(r"system S \{ (.*) until 10s; \}", r"system Unit { \1 }", text)
    two = "r[0]: Unit; r[1]: Unit; until 10s;"
    if rng.random() < 0.3:
        return f"{text}system S {{ {two} }}\n{CONTROL} {{ {two} force r[1].M ac; }}\n"
    return f"{text}system S default {{ {two} }}\n"


def _induction(number: int, rng: random.Random) -> str:
    text = planner(number, late=number % 2 == 0)
    for node in ("Safe", "Follower"):
        if rng.random() < 0.25:
            late = rng.choice(("1ms", "4ms"))
            text = re.sub(rf"(node {node} [^{{]*\{{)", rf"\1 jitter {late};", text)
    return text


# ---------------------------------------------------------------- one program


def judged(text: str, work: Path) -> Found:
    """Verified, rechecked and run."""
    path = work / "program.soter"
    path.write_text(text)
    try:
        report = load(path).verify(cert=work / "cert", refute=False)
    except SoterError as error:
        return Found("refused " + error.diagnostics[0].code, "")
    proved = report.verdict in ("proved", "assumed")
    checked = recheck(work / "cert")
    contradictions = [*_against(report, checked)]
    if CONTROL in text:
        contradictions.append(
            (KINDS[4], f"Control is the default, and forces: {report.system} is judged")
        )
    why = re.sub(r"`[^`]*`", "`...`", checked.reason)
    excused = f"{ANNOUNCED}: {why}" if proved and _announced(report, checked) else ""
    if proved:
        for kind, why in runs_of(path, report):
            if any(SCHEME in getattr(m, "assumed", ()) for m in report.modules):
                excused = "assumed"
            else:
                contradictions.append((kind, why))
    said = "in part" if checked.accepted and not checked.safe else checked.verdict
    return Found(report.verdict, said, tuple(dict(contradictions).items()), excused)


def _against(report: VerifyReport, checked: RecheckReport) -> Iterator[tuple[str, str]]:
    """What verify and recheck say against each other."""
    holds = all(m.findings[p].holds for m in report.modules for p in ("P2a", "P3", "start"))
    proved = report.verdict in ("proved", "assumed")
    if proved and not checked.accepted and not _announced(report, checked):
        yield KINDS[0], f"{checked.verdict}: {checked.reason}"
    if checked.safe and not holds:
        open_ = [p for m in report.modules for p, f in m.findings.items() if not f.holds]
        yield KINDS[1], f"open in verify: {', '.join(open_)}"


def _announced(report: VerifyReport, checked: RecheckReport) -> bool:
    """Whether verify has said of each module that was not re-checked that it could not be."""
    left = {m.name for m in checked.modules if m.not_rechecked}
    said = {m.name for m in report.modules if m.not_rechecked}
    return checked.verdict == "not re-checked" and left <= said and bool(left)


def runs_of(path: Path, report: VerifyReport) -> Iterator[tuple[str, str]]:
    """Runs that violate what is proved."""
    program_ = load(path)
    name = report.system.partition(",")[0]
    for seed in range(1, RUNS + 1):
        run = program_.simulate(name, seed=seed)
        for v in run.violation_list:
            if v.kind != "property":
                yield KINDS[3], f"soter run, seed {seed}: {v.what} at {v.time_s} s"
    checked = check_file(str(path))
    flat = system_to_prove(checked, name)
    complete(flat)
    for m in report.modules:
        outside = any(c.plant is not None and c.plant.extern for c in flat.components)
        if m.problem.kind == "nodes" or outside:
            continue  # there is no plant, or one that only its driver knows
        name = m.name.partition(" as ")[0]  # a view is a part of its module
        index = next(i.index for i in flat.modules if i.name == name)
        yield from _attacked(flat, index)


def _attacked(flat: object, index: int) -> Iterator[tuple[str, str]]:
    """`safe` on true states, AC and the world at their bounds."""
    try:
        attack = attacks._Attack(flat, index, DRAWN)  # type: ignore[arg-type]  # noqa: SLF001
    except NotAttackableError:
        return  # `safe` is about what an abstraction shows
    until = PERIODS * attack.module.period_ns
    plants = [c for c in attack.variant.components if c.plant is not None]
    for pattern in (CORNER, TURN, HOLDS, CHANCE):
        for k in range(1, ATTACKS // 4 + 1):
            row = attack.run_until(attack.new_state((pattern << 56) | k), until)
            first = int(row["properties"][0]["first_ns"])
            if first >= 0:
                yield KINDS[2], f"pattern {pattern}, seed {k}: `safe` is left at {first / 1e9} s"
            for c in plants:
                if row["components"][c.index]["latched"]:
                    yield KINDS[3], f"pattern {pattern}, seed {k}: plant {c.name} stops"


# ---------------------------------------------------------------- all of them


def too_long(*_: object) -> None:
    """What is called when the time of one module is over."""
    raise TooLongError


def main() -> int:
    """Everything."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--modules", type=int, default=300)
    parser.add_argument("--stiff", type=int, default=50)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=int, default=60, help="for one module")
    options = parser.parse_args()
    signal.signal(signal.SIGALRM, too_long)
    began, verdicts, kinds = time.perf_counter(), Counter[str](), Counter[str]()
    shown = 0
    count = options.modules + options.stiff
    for k in range(count):
        number = options.seed * 10_000 + k
        kind, text = program(number, stiff=k >= options.modules)
        signal.alarm(options.seconds)
        try:
            with tempfile.TemporaryDirectory() as work:
                judgement = judged(text, Path(work))
        except TooLongError:
            judgement = Found("too long", "")
        finally:
            signal.alarm(0)
        line = f"{kind}: {judgement.verdict}, {judgement.rechecked or 'not asked'}"
        print(line, file=sys.stderr, flush=True)
        verdicts[line] += 1
        kinds.update([judgement.excused] if judgement.excused else [])
        for what, why in judgement.contradictions:
            kinds[what] += 1
            shown += 1
            print(f"{what}: {kind} {number}: {why[:200]}", flush=True)
    for line, many in sorted(verdicts.items()):
        print(f"{many:5}  {line}")
    for why in sorted(k for k in kinds if k.startswith(ANNOUNCED)):
        print(f"{kinds[why]:5}  {why}")
    print("  ".join(f"{what}: {kinds[what]}" for what in (*KINDS, "assumed")))
    took = f"{time.perf_counter() - began:.0f} s"
    print(f"contradictions: {shown} in {count} programs (target 0), {took}")
    return 1 if shown else 0


if __name__ == "__main__":
    raise SystemExit(main())
