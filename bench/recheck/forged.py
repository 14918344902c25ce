"""Forged certificates of every kind of proof, sealed as right ones are, each in a process.

    .venv/bin/python bench/recheck/forged.py [--count 100] [--seed 1] [--jobs 2]

Purpose: certificates of grids, inductions, deployed and composed systems are forged in
seventeen ways (`forgeries.py`, `late_forgeries.py`): sets, claims, times, inputs, programs, names,
sizes, shields, numbers, and what is swapped between certificates and systems. Each is
checked in a child with a minute of a processor and a limit of memory. An accepted one is *false*
where it confirms of a program, a system, a module and values of parameters what `soter verify` does
not prove of exactly these, also not on a finer grid; where it ends with exit code 0 and a claim
that safety needs is not confirmed; where a shield that it confirms permits a command that leads out
of K by arithmetic of our own. Nothing may be confirmed of a module that was not re-checked.
Certificates that `soter verify` writes have to be accepted, or not re-checked where it says so;
nothing may draw on the terminal.
Non-goals: single cells of one program (`corruptions.py`), every edit of one
(`overstated.py`).
"""

from __future__ import annotations

import argparse
import contextlib
import json
import multiprocessing
import os
import random
import resource
import signal
import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from bench.pieces import Pieces  # noqa: E402 - needs the path
from bench.recheck.forged_programs import OPEN, PROGRAMS  # noqa: E402
from bench.recheck.forgeries import (  # noqa: E402 - needs the path
    KINDS,
    Forged,
    base_of,
    finer,
    forge,
    proved_of,
)
from bench.recheck.late_forgeries import fits, surely_out  # noqa: E402

from soter.certificate.rechecker import recheck  # noqa: E402
from soter.certificate.report import ACCEPTED, NOT_RECHECKED  # noqa: E402
from soter.cli.main import main as main_of_soter  # noqa: E402
from soter.cli.terminal.command_outcome import FINE, UNDECIDED  # noqa: E402

if TYPE_CHECKING:
    from bench.recheck.forgeries import Base, Claim

CPU_S = 60
"""Seconds of a processor that a re-check may take."""
LIMIT_S = 600.0
"""And by the clock: the machine may be busy elsewhere."""
MEMORY = 8 << 30
"""Bytes of address space."""
DRAWING = ("sizes", "names and types")
"""Kinds that may draw on the terminal."""
ASKED = {"P2a", "P3", "ttf", "safer", "start"}
"""Without one of them `soter recheck` may not end with exit code 0."""
ANSWERS = (0, 1, 3, 4, 5)
"""Exits of `soter recheck`: 1 is a folder that is no certificate."""


@dataclass(frozen=True)
class Outcome:
    """What became of a forgery; `wrong`: why its acceptance, or what was printed, is."""

    family: str
    kind: str
    name: str
    exit: int | None
    """Of `soter recheck`; None where it did not end."""
    seconds: float
    reason: str = ""
    wrong: str = ""


# ---------------------------------------------------------------- one re-check, in a child


def checked(folder: Path, *more: str) -> tuple[int | None, str, str, float]:
    """Exit, standard output, standard error and seconds of `soter recheck`; None: killed.

    In a process that is forked, so that nothing is imported again.
    """
    began = time.perf_counter()
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        child = os.fork()
        if child == 0:
            _recheck_here(["recheck", str(folder), *more], out.fileno(), err.fileno())
        code, until = None, began + LIMIT_S
        while code is None and time.perf_counter() < until:
            ended, status = os.waitpid(child, os.WNOHANG)
            if ended:
                code = os.waitstatus_to_exitcode(status)
            else:
                time.sleep(0.02)
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(child, signal.SIGKILL)
        if code is None:
            os.waitpid(child, 0)
        texts = []
        for file in (out, err):
            file.seek(0)
            texts.append(file.read().decode(errors="replace"))
    code = None if code is not None and code < 0 else code
    return code, texts[0], texts[1], time.perf_counter() - began


def _recheck_here(arguments: list[str], out: int, err: int) -> NoReturn:
    """The command, as the child that this process is."""
    code = 70
    try:
        os.setsid()
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        resource.setrlimit(resource.RLIMIT_CPU, (CPU_S, CPU_S))
        os.dup2(out, 1)
        os.dup2(err, 2)
        code = main_of_soter(arguments)
        sys.stdout.flush()
        sys.stderr.flush()
    finally:
        os._exit(code)


# ---------------------------------------------------------------- judging


def _unheard(text: str) -> bool:
    return any(not c.isprintable() and c != "\n" for c in text)


_BASES: dict[str, Base] = {}


def judge(kind: str, family: str, seed: int) -> Outcome:
    """Forge, check, and judge what was accepted."""
    with tempfile.TemporaryDirectory(prefix="forged-") as at:
        folder = Path(at) / "cert"
        made = forge(_BASES, family, kind, seed, folder)
        code, out, err, seconds = checked(folder, "--json")
        reason, wrong = "", ""
        if code in (0, 3, 4, 5):
            report = json.loads(out)
            reason = str(report["reason"])
            wrong = _overstated(made, report, code)
            if report["accepted"] and kind == "shields":
                wrong = wrong or surely_out(made)
            shown = checked(folder) if kind in DRAWING else (None, "", "")
            if shown[0] is not None and _unheard(shown[1] + shown[2]):
                wrong = wrong or "what it prints moves the cursor"
        elif code is None:
            wrong = "no answer: a hang, or a crash"
        elif code not in ANSWERS:
            wrong = f"exit {code}: {err.strip()[-200:]}"
        return Outcome(family, kind, made.name, code, round(seconds, 2), reason, wrong)


def _overstated(made: Forged, report: dict[str, Any], code: int) -> str:
    """What was confirmed and is not so; empty where all of it is."""
    if report["accepted"] != (code in (FINE, UNDECIDED)):
        return f"exit {code}, and accepted is {report['accepted']}"
    for label, module in report["modules"].items():
        open_ = module["verdict"] == NOT_RECHECKED
        if open_ and (module["confirmed"] or report["accepted"]):
            return f"{label} was not re-checked, and something of it is confirmed"
        if not report["accepted"]:
            continue
        name = label.removeprefix(module["system"] + ".").split(" as ")[0]
        sets = f"system {module['system']} {{ set" in made.text
        if sets and module["otherwise"] and code == FINE:
            return f"other values than the system sets: {module['otherwise']}"
        values = tuple(sorted(module["parameters"].items()))
        claim: Claim = (module["system"], name, values)
        confirmed = {c for c in module["confirmed"] if c not in ("P1a", "P1b")}
        if "recover never" in made.text:
            confirmed.discard("P2b")  # nobody asks for it there: it may hold all the same
        missed = confirmed - proved_of(made.text, claim)
        if code == FINE and not confirmed >= ASKED:
            return f"exit 0 without {sorted(ASKED - confirmed)} of {name} in {module['system']}"
        if missed:
            missed -= proved_of(finer(made.text), claim)
        if missed:
            return f"confirmed and not proved of {name} in {module['system']}: {sorted(missed)}"
    return ""


# ---------------------------------------------------------------- all of them


def untouched() -> list[Outcome]:
    """Every certificate as `soter verify` wrote it: whatever is proved has to be accepted."""
    outcomes = []
    for base in _BASES.values():
        for name, variant in {"": base, **base.variants}.items():
            if not (variant.proved or variant.name in OPEN):
                continue
            wanted = NOT_RECHECKED if variant.name == "untold" else ACCEPTED
            with tempfile.TemporaryDirectory(prefix="forged-") as at:
                folder = Path(at) / "cert"
                variant.write(folder)
                report = recheck(folder, workers=1)
            wrong = "" if report.verdict == wanted else f"a right one is {report.verdict}"
            label = f"{base.name} {name}".strip()
            code = {"accepted": 0, "rejected": 3}.get(report.verdict, 5)
            outcomes.append(
                Outcome(base.family, "untouched", label, code, report.seconds, report.reason, wrong)
            )
    return outcomes


def run(count: int, seed: int, jobs: int, keep: Path | None) -> list[Outcome]:
    """`count` forgeries of each kind, dealt out to families in turn, less what `keep` has."""
    _BASES.update({name: base_of(name) for name in PROGRAMS})
    pieces = Pieces(keep, "forged")
    outcomes = [
        Outcome(**o) for o in pieces.piece("untouched", lambda: [*map(asdict, untouched())])
    ]
    families = list(dict.fromkeys(b.family for b in _BASES.values()))
    work = []
    for n, kind in enumerate(KINDS):
        fitting = {b.family for b in _BASES.values() if fits(kind, b)}
        of = [f for f in families if f in fitting]
        work += [(kind, of[k % len(of)], seed * 1_000_000 + 1000 * n + k) for k in range(count)]
    random.Random(seed).shuffle(work)  # noqa: S311 - no secret
    with ProcessPoolExecutor(jobs, multiprocessing.get_context("fork")) as pool:
        asked = {w: pool.submit(judge, *w) for w in work if not pieces.has(str(w))}
        for w in work:
            done = pieces.piece(str(w), lambda w=w: asdict(asked[w].result()))  # type: ignore[misc]
            outcomes.append(Outcome(**done))
    return outcomes


def table(outcomes: list[Outcome]) -> str:
    """Kinds by families: accepted of all; then what is wrong."""
    families = list(dict.fromkeys(o.family for o in outcomes))
    lines = [f"{'kind':<22}" + "".join(f"{f:>14}" for f in families) + f"{'FALSE':>8}{'HANG':>6}"]
    for kind in ("untouched", *KINDS):
        of = [o for o in outcomes if o.kind == kind]
        if not of:
            continue
        row = f"{kind:<22}"
        for family in families:
            own = [o for o in of if o.family == family]
            accepted = sum(o.exit in (0, 4) for o in own)
            row += f"{f'{accepted} of {len(own)}':>14}"
        hangs = sum(o.exit is None for o in of)
        lines.append(row + f"{sum(bool(o.wrong) for o in of) - hangs:>8}{hangs:>6}")
    return "\n".join(lines)


def main() -> int:
    """Print the table; exit 1 where something false was accepted, or did not end."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=100, help="forgeries of each kind")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--keep", type=Path, help="what is done is written there as it comes")
    args = parser.parse_args()
    outcomes = run(args.count, args.seed, args.jobs, args.keep)
    print("accepted (exit 0 or 4) of all that were made")
    print(table(outcomes))
    for o in outcomes:
        if o.wrong:
            print(f"  {o.family}, {o.kind}, {o.name}: {o.wrong} {o.reason[:160]}")
    slowest = max(o.seconds for o in outcomes)
    reasons = Counter(o.reason.split("`")[0][:60] for o in outcomes if o.exit in (3, 5))
    print(f"{len(reasons)} reasons; the slowest took {slowest:.1f} s")
    checks = sum(o.seconds for o in outcomes)
    print(f"{checks:.0f} s of checks, target: 0 false, 0 right rejected, 0 hangs")
    return 1 if any(o.wrong for o in outcomes) else 0


if __name__ == "__main__":
    sys.exit(main())
