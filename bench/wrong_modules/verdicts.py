"""Wrong modules of many kinds: none may be called proved without a word about what is wrong.

    .venv/bin/python bench/wrong_modules/verdicts.py [--only NAME] [--demos]

Purpose: run `soter verify FILE --no-refute` on every module of `timing.py` and of the texts beside
it, and count: it is *refused* with a code, *undecided*, *refuted*, proved with the reason *named*
in what is printed (what is not covered, or assumed), or *proved*, which must not happen. The right
modules that the wrong ones are made from must be proved (control arms). With `--demos` every
demonstration is run, too: a violation in the interpreter's own run, in `soter test`, or in a
simulation of its own. Beside what bench/rows.py says of the texts: `on` is the right module, `why`
what is wrong; `?` is one of `Wrong.named` ("-": none), `$` the command that shows it ("-": nothing
does), `~` an edit before that, `codes` and `options` are those of `Wrong`; a section is a kind.
Non-goals: mutants of laws and predicates (`tests/generators/changed_modules.py`), of certificates.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import re
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from bench.rows import Edit, Groups, edited, edits_of, rows  # noqa: E402 - needs the path
from bench.wrong_modules.base import BASES, Shown, Wrong  # noqa: E402
from bench.wrong_modules.timing import TIMING  # noqa: E402

from soter.cli.main import main as soter  # noqa: E402

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from bench.rows import Row as Text

HERE = Path(__file__).parent
FILES = ("groups.txt", "controllers.txt", "paths.txt", "systems.txt")
WORDS = ("on", "why", "?", "$", "~", "codes", "options")
GROUPS: Groups = {}


def wrong_of(row: Text) -> Wrong:
    """The module of a row: of `line`, and a run violates, where it says nothing else."""

    def edits(word: str) -> tuple[Edit, ...]:
        return tuple(edit for line in row.said.get(word, ()) for edit in edits_of(line, GROUPS))

    (base,) = (b for b in BASES if b.name == (row.one("on") or "line"))
    command = row.one("$") or "run"
    return Wrong(
        row.section,
        row.name,
        base,
        edits(""),
        row.one("why"),
        None if command == "-" else Shown(tuple(command.split()), edits("~")),
        tuple(regex for regex in row.said.get("?", ()) if regex != "-"),
        tuple(row.one("codes").split()),
        tuple(row.one("options").split()),
    )


OF_TEXTS = [wrong_of(row) for name in FILES for row in rows(HERE / name, WORDS, GROUPS)]
WRONG = (*TIMING, *OF_TEXTS)


PROVED, NAMED, REFUSED, UNDECIDED, REFUTED, BROKEN = (
    "proved",
    "named",
    "refused",
    "undecided",
    "refuted",
    "broken",
)
ANSWERS = {0: PROVED, 3: REFUTED, 4: UNDECIDED}
CODE = re.compile(r"\berror\[(\w+)\]")
NOTHING_SHOWN, SHOWN, NOT_SHOWN = "argued", "shown", "NOT SHOWN"


@dataclass
class Row:
    """One wrong module."""

    kind: str
    name: str
    answer: str
    """PROVED, NAMED, REFUSED, UNDECIDED, REFUTED; BROKEN where the program itself is no program."""
    detail: str
    """Codes, or what named the reason."""
    demonstration: str
    seconds: float


@dataclass(frozen=True)
class Said:
    """What a command line printed, and its exit code."""

    exit: int
    report: str
    text: str
    """The report, and what else was said."""
    codes: tuple[str, ...]


def call(text: str, words: Sequence[str], name: str = "wrong") -> Said:
    """`soter WORDS[0] FILE WORDS[1:]` in this process, on a file with this text."""
    with tempfile.TemporaryDirectory() as folder, _inside(folder):
        file = Path(f"{name}.soter")
        file.write_text(text, encoding="utf-8")
        out, err = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            code = soter([words[0], str(file), *words[1:]])
    printed = out.getvalue() + err.getvalue()
    return Said(code, out.getvalue(), printed, tuple(dict.fromkeys(CODE.findall(printed))))


@contextlib.contextmanager
def _inside(folder: str) -> Iterator[None]:
    """`folder` is the current one: programs have short names, and runs leave their files there."""
    before = Path.cwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


def judged(wrong: Wrong) -> tuple[str, str, str]:
    """The answer of `soter verify`, what it rests on, and all that was printed."""
    said = call(wrong.text, ("verify", *wrong.options, "--no-refute"))
    if said.exit not in ANSWERS:
        fine = said.codes and all(c[0] in "RP" or c in wrong.codes for c in said.codes)
        return (REFUSED if fine else BROKEN), " ".join(said.codes), said.text
    answer = ANSWERS[said.exit]
    if answer == PROVED:
        for pattern in wrong.named:
            match = re.search(pattern, said.report)
            if match:
                return NAMED, match.group(0), said.text
    return answer, "", said.text


def demonstrated(shown: Shown | None, text: str) -> str:
    """Whether the demonstration shows what it should."""
    if shown is None:
        return NOTHING_SHOWN
    if shown.loop is not None:
        return SHOWN if shown.loop() is not None else NOT_SHOWN
    said = call(edited(text, shown.edits), shown.command)
    return SHOWN if said.exit == 3 else NOT_SHOWN


def examine(wrong: Wrong, *, demos: bool) -> tuple[Row, str]:
    """Judge, and demonstrate."""
    began = time.process_time()
    answer, detail, printed = judged(wrong)
    demonstration = demonstrated(wrong.shown, wrong.text) if demos else ""
    seconds = time.process_time() - began
    return Row(wrong.kind, wrong.name, answer, detail, demonstration, seconds), printed


def main() -> int:
    """Run all, print the table; 1 unless nothing wrong is proved and the control arms are."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", help="only modules with this in their name")
    parser.add_argument("--demos", action="store_true", help="run the demonstrations, too")
    arguments = parser.parse_args()
    chosen = [w for w in WRONG if arguments.only is None or arguments.only in w.name]
    arms = {} if arguments.only else _control_arms()
    rows = []
    for wrong in chosen:
        row, printed = examine(wrong, demos=arguments.demos)
        rows.append(row)
        bad = "  <== PROVED" if row.answer == PROVED else ""
        print(
            f"{row.kind:14} {row.name:58} {row.answer:9} {row.detail[:30]:30} "
            f"{row.demonstration:9} {row.seconds:5.1f}{bad}",
            flush=True,
        )
        if row.answer == BROKEN:
            print(printed)
    print()
    _table(rows)
    figures = {
        "wrong modules": len(rows),
        "proved (0)": sum(r.answer == PROVED for r in rows),
        "control arms": len(arms),
        "control arms proved": sum(answer == PROVED for answer in arms.values()),
        "CPU seconds": round(sum(r.seconds for r in rows), 1),
    }
    if arguments.demos:
        figures |= {
            "demonstrated": sum(r.demonstration == SHOWN for r in rows),
            "argued": sum(r.demonstration == NOTHING_SHOWN for r in rows),
            "demonstration that shows nothing (0)": sum(r.demonstration == NOT_SHOWN for r in rows),
        }
    for name, value in figures.items():
        print(f"{name:40} {value}")
    wrong_answers = any(r.answer in (PROVED, BROKEN) for r in rows)
    not_shown = any(r.demonstration == NOT_SHOWN for r in rows)
    idle = any(answer != PROVED for answer in arms.values())
    return 1 if wrong_answers or not_shown or idle else 0


def _control_arms() -> dict[str, str]:
    answer_by_base = {}
    for base in BASES:
        said = call(base.text, ("verify",))
        runs = call(base.text, ("run",))
        harmed = "" if runs.exit == 0 else "  and its run is violated"
        answer_by_base[base.name] = ANSWERS.get(said.exit, BROKEN) + harmed
        print(f"{'control arm':14} {base.name:58} {answer_by_base[base.name]}", flush=True)
        if said.exit != 0:
            print(said.text)
    return answer_by_base


def _table(rows: list[Row]) -> None:
    answers = (PROVED, REFUSED, UNDECIDED, REFUTED, NAMED, BROKEN)
    print(f"{'kind':16} {'modules':>8} " + " ".join(f"{a:>9}" for a in answers))
    kinds = list(dict.fromkeys(r.kind for r in rows))
    for kind in [*kinds, "all"]:
        here = [r for r in rows if kind in (r.kind, "all")]
        count = Counter(r.answer for r in here)
        print(f"{kind:16} {len(here):8} " + " ".join(f"{count[a]:9}" for a in answers))


if __name__ == "__main__":
    sys.exit(main())
