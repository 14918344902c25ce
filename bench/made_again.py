"""Make the figures of docs/ again, and say which ones did not come out.

    make figures          (or: .venv/bin/python bench/made_again.py [--small] [--only TEXT] ...)

Purpose: before a release every table, block and sentence with figures stands beside what its
command prints today (bench/made_again_sections.py has them): rows of docs/benchmarks.md beside
a new run, other pages beside the same output. `--small` makes the quicker runs, in which what is 0
has to be 0 and shares have to fit, as with `--only X --with "ARGUMENTS" --flights N`, which is one
shorter run of your own; `--kept` runs nothing: pages beside the kept output of
docs/benchmarks.md. Outputs and verdicts are written to build/made-again as they come; `--resume`
takes outputs of the code that is checked out. Exit code: 0 all figures came out; 3 something
differs; 4 nothing differs, and something was not made.
Non-goals: mending pages; `make bench` writes docs/benchmarks.md.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shlex
import signal
import subprocess
import sys
import time
from collections import Counter
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from bench.benchmark_rows import BENCHMARKS  # noqa: E402 - needs the path
from bench.made_again_compare import (  # noqa: E402 - needs the path
    ROW_RULE,
    Compared,
    compared,
    counted,
    numbers_in,
    sampled,
    stood,
)
from bench.made_again_sections import PAGES, SMALL, Made  # noqa: E402
from bench.run_all import (  # noqa: E402 - needs the path
    BLOCK,
    Result,
    machine,
    now,
    printed,
    results,
    write,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

DOCS = ROOT / "docs"
OUT = ROOT / "build" / "made-again"
LONGEST = 1e6
"""No command is waited for longer, s: poll(2) cannot wait for a month."""
BENCHMARK = "@"
TEST = "-m pytest"
WHOLE_PAGE = "*"


@dataclass(frozen=True)
class Section:
    """What is compared: a text of a page, the command, and how.

    `flights` is 0 where the command is the whole one; else `part` says that it has fewer rows, and
    not fewer flights a row. `machine` says why only zeros are compared.
    """

    page: str
    name: str
    command: str
    flights: int
    times: str | None
    machine: str
    made: Made | None
    part: bool = False

    @property
    def title(self) -> str:
        """Page and section."""
        return f"{self.page} / {self.name}"


@dataclass
class Output:
    """What a command printed, its exit code, for how long (s, wall), and what it was made of."""

    text: str
    code: int | None
    seconds: float
    of: str


@dataclass
class Verdict:
    """A line of the report: figures that were compared, what differs, or why nothing was made."""

    section: str
    command: str
    figures: int = 0
    differ: list[str] = field(default_factory=list)
    not_made: str = ""
    seconds: float = 0.0


def sections(*, small: bool) -> list[Section]:
    """Every row of docs/benchmarks.md, then those of the other pages.

    `small`: of these the blocks alone; what a row or a sentence says is of the whole run.
    """
    kept, found = results(), []
    for b in BENCHMARKS:
        s = SMALL[b.name]
        whole = kept[b.name].command.removeprefix("python ") if b.name in kept else b.arguments
        reduced = small and bool(s.arguments or s.instead)
        command = (s.instead or f"{whole} {s.arguments}") if reduced else whole
        flights = s.flights if reduced else 0
        found.append(
            Section("benchmarks.md", b.name, command, flights, s.times, s.machine, None, s.part)
        )
    by_name = {s.name: s for s in found}
    for m in PAGES:
        if small and not a_block(m):
            continue
        name = m.where.lstrip("`").split("\n")[0][:60]
        if m.command.startswith(BENCHMARK):
            of = by_name[m.command[1:]]
            found.append(
                Section(m.page, name, of.command, of.flights, m.times or of.times, of.machine, m)
            )
        else:
            reduced = small and bool(m.small)
            command = m.small if reduced else m.command
            found.append(
                Section(m.page, name, command, m.flights if reduced else 0, m.times, "", m)
            )
    return found


def a_block(m: Made) -> bool:
    """Whether the page has what the command printed: a row or a sentence is of the whole run."""
    return m.where.startswith(("```", WHOLE_PAGE))


def may_be_less(s: Section) -> bool:
    """Whether a run of fewer flights can be held against it."""
    return s.made is None or (a_block(s.made) and not s.command.startswith(TEST))


def shorter(s: Section, more: str, flights: int) -> Section:
    """A section made with these arguments, which are of fewer flights a row: a tenth, say."""
    return replace(s, command=f"{s.command} {more}", flights=flights)


# ---------------------------------------------------------------- what a page says


def table(page: str, where: str) -> list[str]:
    """The rows of a table, by its head or, where that is empty, by its first row."""
    text = page.splitlines()
    starts = [k for k, line in enumerate(text) if line.startswith(where)]
    rows = []
    for line in text[starts[0] if starts else len(text) :]:
        if not line.startswith("|"):
            break
        rows.append(line)
    return rows[2:] if len(rows) > 1 and ROW_RULE.match(rows[1]) else rows


def block(page: str, where: str) -> str:
    """The text of the block whose first line begins so; empty where there is none."""
    start = where.removeprefix("```")
    texts = (m.group(2) for m in BLOCK.finditer(page))
    return next((t for t in texts if t.lstrip("\n").startswith(start)), "")


def without_prompts(text: str) -> str:
    """A session without its commands."""
    return "\n".join(x for x in text.splitlines() if not x.startswith("$ "))


def said(m: Made, page: str) -> Iterator[str]:
    """What of a page is to be made: rows, a block, or the figures of a sentence."""
    if m.where == WHOLE_PAGE:
        yield page
    elif m.where.startswith("|"):
        yield from table(page, m.where)
    elif m.where.startswith("```"):
        yield from filter(None, [without_prompts(block(page, m.where))])
    else:
        yield from ("; ".join(found.groups()) for found in re.finditer(m.where, page))


# ---------------------------------------------------------------- comparing


def judged(s: Section, text: str) -> Compared:
    """A section beside an output of its command."""
    if s.made is None:
        kept = results().get(s.name)
        if kept is None:
            return Compared()
        return _as_lines(s, printed(kept.text), text)
    page = (DOCS / s.page).read_text(encoding="utf-8")
    told = list(said(s.made, page))
    if not told:
        return Compared(0, ["the page has no such table, block or sentence"])
    if s.made.where == WHOLE_PAGE or s.made.where.startswith("```"):
        return _as_lines(s, told[0], text)
    if s.machine:
        text = printed(results()[s.made.command[1:]].text)
    return stood(told, text, frozenset(s.made.given.split()), spread=s.made.spread)


def _as_lines(s: Section, kept: str, text: str) -> Compared:
    """Line by line; only zeros and shares where it is a smaller run, or another machine's."""
    if s.part and s.flights:
        return compared(kept, text, s.times, part=True)
    if s.flights or s.machine:
        return sampled(kept, text, max(s.flights, 1), s.times)
    return compared(kept, text, s.times, whole=s.made is None)


def held(s: Section, output: Output) -> Compared:
    """A section whose figures a test holds: they are right if it passes."""
    assert s.made is not None
    told = list(said(s.made, (DOCS / s.page).read_text(encoding="utf-8")))
    figures = sum(len(numbers_in(x)) for x in told)
    right = output.code == 0 and figures > 0
    return Compared(figures, [] if right else [f"the test that holds it: {_last(output.text)}"])


def _last(text: str) -> str:
    """The last line of an output that says anything."""
    return next((x.strip() for x in reversed(text.splitlines()) if x.strip()), "nothing printed")


# ---------------------------------------------------------------- running


def made_of(command: str) -> str:
    """Which code, examples and benchmark are checked out; nothing where they were edited since."""
    first = command.split(maxsplit=1)[0]
    folder = str(Path(first).parent) if first.endswith(".py") else "tests"
    what = ("src", "examples", folder)
    edited = _git("status", "--porcelain", *what)
    trees = _git("rev-parse", *(f"HEAD:{x}" for x in what)).split()
    return "" if edited.strip() else " ".join(x[:8] for x in trees)


def _git(*arguments: str) -> str:
    command = ["git", *arguments]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False).stdout


def run(command: str, limit_s: float, reads: str = "") -> Output:
    """A command's output; code None where it was ended after `limit_s`, with all it started."""
    began = time.monotonic()
    if reads:
        (ROOT / reads).unlink(missing_ok=True)
    with subprocess.Popen(
        [sys.executable, *shlex.split(command)], cwd=ROOT, stdout=subprocess.PIPE,
        stderr=subprocess.PIPE, text=True, start_new_session=True,
    ) as child:  # fmt: skip
        code: int | None = None
        try:
            text, wrong = child.communicate(timeout=min(limit_s, LONGEST))
            code = child.returncode
        except subprocess.TimeoutExpired:
            os.killpg(child.pid, signal.SIGKILL)
            text, wrong = child.communicate()
        except BaseException:
            os.killpg(child.pid, signal.SIGKILL)
            raise
    if reads and (ROOT / reads).exists():
        text = (ROOT / reads).read_text(encoding="utf-8")
    if "Traceback (most recent call last)" in wrong or not text.strip():
        text = f"{text}\n{wrong}"
        code = 70 if code == 0 else code
    return Output(text, code, time.monotonic() - began, made_of(command))


BROKEN = (2, 70, 127)
"""Exit codes of a command that made no figures: usage, a defect, no such program."""


def verdict(s: Section, output: Output) -> Verdict:
    """What came of a section."""
    told = Verdict(s.title, s.command, seconds=output.seconds)
    if output.code is None:
        told.not_made = f"ended after {output.seconds:.0f} s"
    elif s.command.startswith(TEST) and s.made is not None:
        c = held(s, output)
        told.figures, told.differ = c.figures, c.differ
    elif output.code in BROKEN or output.code < 0:
        told.not_made = f"exit {output.code}: {_last(output.text)}"
    else:
        c = judged(s, output.text)
        told.figures, told.differ = c.figures, c.differ
        if not c.figures and not c.differ:
            told.not_made = "no figure of it can be compared with this run"
    return told


def shown(v: Verdict) -> str:
    """A line of the report, and what differs below it."""
    state = v.not_made and f"NOT MADE: {v.not_made}"
    state = state or (f"{len(v.differ)} DIFFER" if v.differ else "as the page says")
    line = f"{v.section}\n  {v.command}\n  {v.figures} figures, {state}, {v.seconds:.1f} s"
    return "\n".join(filter(None, [line, counted(v.differ)]))


def kept_outputs() -> Iterator[tuple[Section, Output]]:
    """Sections of other pages, beside what is kept of the row of docs/benchmarks.md."""
    kept = results()
    for s in sections(small=False):
        if s.made is not None and s.made.command.startswith(BENCHMARK):
            text = printed(kept[s.made.command[1:]].text)
            yield s, Output(text, 0, 0.0, kept[s.made.command[1:]].commit)


def made_outputs(
    chosen: list[Section], file: Path, *, resume: bool, seconds: float, each: float
) -> Iterator[tuple[Section, Output]]:
    """Sections with the outputs of their commands, each of which is run once; kept in `file`.

    What took long the last time comes last.
    """
    began = time.monotonic()
    known: dict[str, Output] = {}
    if file.exists():
        told = json.loads(file.read_text(encoding="utf-8"))
        known = {c: Output(**o) for c, o in told.items()}
    fresh = {
        c for c, o in known.items() if resume and o.code is not None and o.of and o.of == made_of(c)
    }
    took = {c: o.seconds for c, o in known.items()}
    for s in sorted(chosen, key=lambda s: took.get(s.command, 0.0)):
        if s.command not in fresh:
            left = seconds - (time.monotonic() - began)
            if left <= 0:
                yield s, Output("", None, 0.0, "")
                continue
            reads = s.made.reads if s.made is not None else ""
            known[s.command] = run(s.command, min(each, left), reads)
            fresh.add(s.command)
            file.parent.mkdir(parents=True, exist_ok=True)
            text = json.dumps({c: asdict(o) for c, o in known.items()}, indent=1)
            file.with_suffix(".new").write_text(text, encoding="utf-8")
            file.with_suffix(".new").replace(file)
        yield s, known[s.command]


def main() -> int:
    """Run, compare, and say it section by section."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--small", action="store_true", help="the quicker runs")
    parser.add_argument("--kept", action="store_true", help="run nothing: pages among each other")
    parser.add_argument("--only", nargs="+", default=[""], help="sections with one of these texts")
    parser.add_argument("--resume", action="store_true", help="take outputs of this code")
    parser.add_argument("--with", dest="more", default="", help="arguments of a shorter run")
    parser.add_argument("--flights", type=int, default=1, help="of which a row has so many")
    add = parser.add_argument
    add("--seconds", type=float, default=LONGEST, help="begin nothing after so many")
    add("--each", type=float, default=LONGEST, help="seconds that a command may take")
    parser.add_argument(
        "--write", action="store_true", help="put whole rows into docs/benchmarks.md, made now"
    )
    parser.add_argument("--list", action="store_true", help="name the sections, run nothing")
    arguments = parser.parse_args()
    wanted = [x.lower() for x in arguments.only]
    chosen = [
        s for s in sections(small=arguments.small) if any(x in s.title.lower() for x in wanted)
    ]
    if arguments.more:
        chosen = [shorter(s, arguments.more, arguments.flights) for s in chosen if may_be_less(s)]
    if arguments.list:
        print("\n".join(f"{s.title}\n  {s.command}" for s in chosen))
        return 0
    titles = {s.title for s in chosen}
    name = "small.json" if arguments.small else "whole.json"
    outputs = made_outputs(
        chosen, OUT / name, resume=arguments.resume, seconds=arguments.seconds,
        each=arguments.each,
    )  # fmt: skip
    if arguments.kept:
        outputs = ((s, o) for s, o in kept_outputs() if s.title in titles)
    verdicts = []
    for s, output in outputs:
        verdicts.append(verdict(s, output))
        if arguments.write and s.made is None and not s.flights and not verdicts[-1].not_made:
            written(s, output)
        print(shown(verdicts[-1]), flush=True)
    return told_at_last(verdicts, OUT / f"verdicts-{name}")


def written(s: Section, output: Output) -> None:
    """Put an output of a whole run into docs/benchmarks.md, where notes stay as they are."""
    kept = results()
    block = f"```\n{output.text.rstrip()}\n```"
    old = kept[s.name]
    text = BLOCK.sub(lambda _: block, old.text, count=1)
    kept[s.name] = Result(f"python {s.command}", *now(), machine(), text, old.about)
    write(kept)


def told_at_last(verdicts: list[Verdict], file: Path) -> int:
    """Write the verdicts, print their sums, and say the exit code."""
    file.parent.mkdir(parents=True, exist_ok=True)
    known = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    known |= {v.section: asdict(v) for v in verdicts}
    text = json.dumps(known, indent=1, ensure_ascii=False)
    file.write_text(text + "\n", encoding="utf-8")
    states = Counter(
        "not made" if v.not_made else "differ" if v.differ else "as the page says" for v in verdicts
    )
    figures = sum(v.figures for v in verdicts)
    print(f"{len(verdicts)} sections, {figures:,} figures compared: ", end="")
    print(", ".join(f"{n} {state}" for state, n in sorted(states.items())))
    return 3 if states["differ"] else 4 if states["not made"] or not verdicts else 0


if __name__ == "__main__":
    sys.exit(main())
