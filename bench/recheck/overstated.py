"""Certificates that say more than is true, sealed again.

    .venv/bin/python bench/recheck/overstated.py [--share 1.0] [--seed 1] [--jobs 2]

Purpose: edits of programs, parameters, modules, systems, times, claims, inputs, assumptions and
tables of small modules (`small_modules.py`), every hash made right; `soter recheck` must accept
none that overstates, and reject none that `soter verify` writes. What an edit is is known
beforehand, or the edited program is verified anew: what the re-checker confirms the prover must
prove, too, on that grid or on one four times as fine. A time that is reported overstates where an
enumeration of every schedule, which knows neither prover nor re-checker, exceeds it.
Non-goals: enlarged sets of one program by single cells (`corruptions.py`).
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import random
import re
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from bench.recheck.sealing import fit, read, seal, write  # noqa: E402 - needs the path
from bench.recheck.small_modules import (  # noqa: E402 - the same
    PROGRAMS,
    REACHED,
    Edit,
    manifest_edits,
    program_edits,
    table_edits,
)

import soter  # noqa: E402
from generators.every_schedule_of_module import EverySchedule  # noqa: E402 - needs the path
from generators.schedule_systems import scaled  # noqa: E402 - needs the path
from soter.certificate.reading.module_facts import DiffersError  # noqa: E402
from soter.certificate.reading.problem import read_facts  # noqa: E402
from soter.certificate.rechecker import recheck  # noqa: E402
from soter.certificate.report import NotRecheckedError  # noqa: E402
from soter.diagnostics.diagnostic import SoterError  # noqa: E402
from soter.language.front_end import check_file, system_of  # noqa: E402
from soter.verify.problem.problem import assumption_texts  # noqa: E402

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.certificate.report import Report
    from soter.verify.problem.schedule import Schedule

MAIN = "small.soter"
MILLISECOND = 1_000_000
NOT_PROVED = "confirmed and not proved anew"
KINDS = (
    *("assumptions", "times", "claims", "inputs", "names", "parameters"),
    *("tables", "numbers", "structure"),
)


@dataclass(frozen=True)
class Base:
    """A certificate that is right, in memory."""

    name: str
    text: str
    manifest: dict[str, Any]
    contents: dict[str, bytes]
    said: tuple[str, ...]
    confirmed: tuple[str, ...]
    reached: dict[str, int]


@dataclass(frozen=True)
class Outcome:
    """What became of an edit; `wrong`: why what was accepted overstates.

    `written`: why a certificate of the edited program that `verify` wrote was rejected.
    """

    base: str
    kind: str
    name: str
    accepted: bool
    reason: str
    wrong: str = ""
    proved: bool = False
    written: str = ""


# ---------------------------------------------------------------- certificates


def proved_anew(folder: Path, text: str, values: dict[str, str] | None = None) -> Any:  # noqa: ANN401
    """What `verify` says; None where there is nothing to be verified."""
    path = folder / MAIN
    for name, value in (values or {}).items():
        text = re.sub(rf"(param {name}: float) = [\d.]+", rf"\1 = {value}", text)
    path.write_text(text)
    try:
        return soter.load(path).verify(cert=folder / "cert", refute=False)
    except SoterError:
        return None


def base_of(name: str) -> Base:
    """The certificate of a program, accepted."""
    with tempfile.TemporaryDirectory() as at:
        proof = proved_anew(Path(at), PROGRAMS[name])
        assert proof is not None
        assert proof.verdict == "proved", name
        folder = Path(at) / "cert"
        report = recheck(folder, workers=1)
        assert report.accepted, (name, report.reason)
        manifest, contents = read(folder)
    said = tuple(a.key for a in report.all_assumptions)
    confirmed = tuple(report.modules[0].confirmed)
    reached = reached_by(proof.modules[0].problem.times.schedule)
    return Base(name, PROGRAMS[name], manifest, contents, said, confirmed, reached)


def reached_by(schedule: Schedule) -> dict[str, int]:
    """The derived times of a manifest, each the worst of every schedule on a grid of 1 ms, in ns.

    All times of the programs are whole milliseconds.
    """
    worst = EverySchedule(scaled(schedule, 1, MILLISECOND)).enumerate()
    return {key: (worst[quantity] or 0) * MILLISECOND for key, quantity in REACHED.items()}


def edits_of(base: Base) -> Iterator[Edit]:
    """All of them."""
    yield from manifest_edits(base.manifest)
    yield from table_edits(base.manifest)
    yield from program_edits(base.text)


def sealed(folder: Path, base: Base, edit: Edit) -> None:
    """The edited certificate, every hash right and the manifest as the edited program has it."""
    manifest = json.loads(json.dumps(base.manifest))
    contents = dict(base.contents)
    if edit.text is not None:
        contents[f"program/{MAIN}"] = edit.text.encode()
    if edit.tables is not None:
        edit.tables(contents, manifest)
    write(folder, contents)
    if edit.text is not None:
        _adapt(folder, manifest)
    if edit.manifest is not None:
        edit.manifest(manifest)
    seal(folder, manifest, contents)


def _adapt(folder: Path, manifest: dict[str, Any]) -> None:
    """What whoever edits a program would do, too: the figures of the manifest follow it."""
    checked = check_file(str(folder / "program" / MAIN))
    if not checked.ok or checked.program is None:
        return
    entry = manifest["modules"][0]
    manifest["program_sha256"] = checked.program.sha256
    manifest["params"] = {}
    try:
        facts = read_facts(system_of(checked, entry["system"]), entry["module"])
    except (SoterError, DiffersError, NotRecheckedError):
        return
    fit(entry, facts)
    recover = facts.symbol.verify.recover
    if recover is None:
        entry["recover_ns"] = None
    elif entry["claims"].get("P2b") == "proved":
        entry["recover_ns"] = int(getattr(recover, "value", 0)) or entry["recover_ns"]


# ---------------------------------------------------------------- judging


def judge(base: Base, edit: Edit) -> Outcome:
    """Seal, recheck, and judge what was accepted; of an edited program also what is written."""
    with tempfile.TemporaryDirectory(prefix="overstated-") as at:
        folder = Path(at) / "edited"
        sealed(folder, base, edit)
        report = recheck(folder, workers=1)
        wrong, proved, written = "", False, ""
        if edit.text is not None or edit.kind == "parameters":
            anew = proved_anew(Path(at), edit.text or base.text, edit.values)
            proved = anew is not None and anew.verdict == "proved"
            if proved:
                again = recheck(Path(at) / "cert", workers=1)
                written = "" if again.accepted else again.reason
            if report.accepted:
                wrong = _against(report, anew)
            if wrong.startswith(NOT_PROVED):
                finer = proved_anew(Path(at), _finer(edit.text or base.text), edit.values)
                wrong = _against(report, finer)
        if report.accepted:
            wrong = wrong or _said(base, edit, report)
    return Outcome(
        base.name, edit.kind, edit.name, report.accepted, report.reason, wrong, proved, written
    )


def _finer(text: str) -> str:
    """The same program on cells a quarter as long.

    Of a core on the finer grid, which holds that of the coarser one, a claim says more.
    """
    return re.sub(r"(\] / )(\d+);", lambda m: f"{m[1]}{4 * int(m[2])};", text)


def _against(report: Report, anew: Any) -> str:  # noqa: ANN401
    """What is confirmed and not proved of the edited program."""
    if anew is None:
        return "the prover has nothing to verify there"
    (module,) = report.modules
    for other in anew.modules:
        verdict_by_property = {n: f.verdict for n, f in other.findings.items()}
        missed = [n for n in module.confirmed if verdict_by_property.get(n) != "proved"]
        if missed:
            return f"{NOT_PROVED}: {', '.join(missed)}"
        told = "\n".join(assumption_texts(other.assumptions))
        keys = {a.key for a in report.all_assumptions}
        if ("never drop out" in told) != ("no dropout" in keys):
            return "drop-outs are assumed by one of the two"
        if "undeclared times" in told and not any(k.startswith("undeclared") for k in keys):
            return "undeclared times are not said"
    return ""


def _said(base: Base, edit: Edit, report: Report) -> str:
    """What is known of an edit beforehand, and what the report must say whatever it is."""
    if edit.wrong:
        return "known to overstate"
    (module,) = report.modules
    if (
        edit.text is None
        and edit.kind != "parameters"
        and {a.key for a in report.all_assumptions} != {*base.said}
    ):
        return "other assumptions than the program has"
    if edit.text is None:
        short = [k for k, v in base.reached.items() if module.times[k] < v]
        if short:
            return f"a schedule exceeds what is reported: {', '.join(short)}"
    if edit.kind in ("assumptions", "times") and not set(module.confirmed) <= set(base.confirmed):
        return "more is confirmed than was"
    if any(module.parameters.get(n) != v for n, v in edit.values.items()):
        return "the values of the parameters are not those that were checked"
    if not any(s.key == "parameters" for s in report.not_covered):
        return "other values of parameters are not named"
    return ""


_BASES: dict[str, Base] = {}


def _judge(job: tuple[str, int]) -> Outcome:
    base = _BASES[job[0]]
    edit = list(edits_of(base))[job[1]]
    try:
        return judge(base, edit)
    except Exception as error:  # noqa: BLE001 - a crash is a finding
        crash = f"crash: {type(error).__name__}: {error}"
        return Outcome(base.name, edit.kind, edit.name, accepted=False, reason="", wrong=crash)


def run(share: float, seed: int, jobs: int) -> list[Outcome]:
    """All edits of all bases, or a share of them."""
    dice = random.Random(seed)  # noqa: S311 - no secret
    for name in PROGRAMS:
        _BASES[name] = base_of(name)
    todo = [(n, k) for n, b in _BASES.items() for k in range(len(list(edits_of(b))))]
    todo = [job for job in todo if dice.random() < share]
    if jobs == 1:
        return [_judge(job) for job in todo]
    with multiprocessing.get_context("fork").Pool(jobs) as pool:
        outcomes = []
        for outcome in pool.imap(_judge, todo, chunksize=8):
            outcomes.append(outcome)
            if len(outcomes) % 100 == 0:
                print(f"{len(outcomes)} of {len(todo)}", file=sys.stderr, flush=True)
        return outcomes


def main() -> int:
    """Print the table; exit 1 where something that overstates was accepted."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--share", type=float, default=1.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    args = parser.parse_args()
    began = time.perf_counter()
    outcomes = run(args.share, args.seed, args.jobs)
    heads = ("count", "rejected", "accepted, true", "OVERSTATED", "written", "REJECTED")
    print(f"{'edit':<14}{heads[0]:>7}{heads[1]:>10}{heads[2]:>16}{heads[3]:>12}", end="")
    print(f"{heads[4]:>9}{heads[5]:>10}")
    for kind in (*KINDS, "all"):
        of = [o for o in outcomes if kind in (o.kind, "all")]
        wrong = sum(bool(o.wrong) for o in of)
        accepted = sum(o.accepted for o in of)
        print(f"{kind:<14}{len(of):>7}{len(of) - accepted:>10}{accepted - wrong:>16}", end="")
        print(f"{wrong:>12}{sum(o.proved for o in of):>9}{sum(bool(o.written) for o in of):>10}")
    for o in outcomes:
        if o.wrong:
            print(f"  {o.base}: {o.kind}: {o.name}: {o.wrong}")
    for reason, count in Counter(o.written for o in outcomes if o.written).most_common(12):
        print(f"  written by verify and rejected, {count} times: {reason}")
    print(f"{time.perf_counter() - began:.0f} s, target: 0 overstated, 0 written and rejected")
    return 1 if any(o.wrong for o in outcomes) else 0


if __name__ == "__main__":
    sys.exit(main())
