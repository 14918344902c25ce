"""Run every benchmark and write docs/benchmarks.md from what they print.

    make bench            (or: .venv/bin/python bench/run_all.py [--only NAME | --write])

Purpose: no figure in the docs that a command did not make. bench/results.json holds when each
command ran, at which commit and where; docs/benchmarks/ what it printed, below a line of `=`, with
notes beside that, and above the line what to know before: the first lines of the program that ran,
until somebody writes something better there. The table of the page is made of both. `--only` makes
one row anew, `--write` but the page.
Non-goals: judging; every benchmark prints its targets beside its figures.
"""

from __future__ import annotations

import argparse
import ast
import json
import platform
import re
import shlex
import subprocess
import sys
import textwrap
from dataclasses import asdict, dataclass
from datetime import datetime, timezone
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from bench.benchmark_rows import BENCHMARKS, Benchmark  # noqa: E402 - needs the path
from bench.headlines import headlines, targets  # noqa: E402 - the same

PAGE = ROOT / "docs" / "benchmarks.md"
OUTPUTS = ROOT / "docs" / "benchmarks"
RESULTS = ROOT / "bench" / "results.json"
BLOCK = re.compile(r"^```([^\n`]*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
RULE = "=" * 80
"""Above it is what this program writes into a file of an output."""
CITED = re.compile(r"\[[\d-]{10}, [0-9a-f]{8}\]\(benchmarks/([\w-]+\.txt)\)")
"""A row as other pages cite it, by when it was made and after which commit."""
HEAD = """# Benchmarks

Written by `make bench`, a command a row. The name leads to the whole output and to the sentences
that say what it means. *Last* are lines of that output, or the cells of a table in it that matter
most. The machines are shared ones with two cores: read ratios and medians, not single times.
*Machine* is empty where nobody wrote it down; an empty target means that the benchmark states none.

A change is committed with its own figures, a line of [line.jsonl](benchmarks/line.jsonl) that `make
bench-line` appends in some minutes. All lines so far, each figure from its least to its largest:

![Figures of each change: lines of code, times as ratios, slips, escapes, outputs](img/line.svg)

| what | target | last | made | machine | command |
|---|---|---|---|---|---|"""


@dataclass(frozen=True)
class Result:
    """What a command printed: when (YYYY-MM-DD), after which commit, where, with notes around.

    `about` is what to know before.
    """

    command: str
    made: str
    commit: str
    machine: str
    text: str
    about: str = ""


def machine() -> str:
    """Facts about this machine, in a line."""
    cpu = "unknown CPU"
    info = Path("/proc/cpuinfo")
    if info.exists():
        match = re.search(r"model name\s*: (.*)", info.read_text())
        cpu = match.group(1) if match else cpu
    cc = subprocess.run(["cc", "--version"], capture_output=True, text=True, check=False)
    compiler = cc.stdout.splitlines()[0] if cc.stdout else "no cc"
    python = platform.python_version()
    return f"{cpu}; {compiler}; Python {python}; {platform.system()} {platform.machine()}"


def file_of(name: str) -> Path:
    """Where the output of a benchmark stands, named as a forge names the anchor of a heading."""
    return OUTPUTS / (re.sub(r"[^\w\- ]", "", name.lower()).replace(" ", "-") + ".txt")


def results() -> dict[str, Result]:
    """What is kept, by benchmark."""
    kept = json.loads(RESULTS.read_text(encoding="utf-8"))
    there = {name: file_of(name).read_text(encoding="utf-8").split(RULE) for name in kept}
    return {
        name: Result(**kept[name], text=text.strip(), about=" ".join(head.split("\n\n")[1].split()))
        for name, (head, text) in there.items()
    }


def first_lines(program: str) -> str:
    """What a program says first about itself."""
    if program.startswith("-m"):
        return ""
    tree = ast.parse((ROOT / program).read_text(encoding="utf-8"))
    return (ast.get_docstring(tree) or "").partition("\n\n")[0]


def printed(text: str) -> str:
    """What a command printed of a kept text: its blocks; notes stand around them."""
    return "\n".join(m.group(2) for m in BLOCK.finditer(text)) or text


def write(made: dict[str, Result]) -> None:
    """The data, the outputs, the page in the order of BENCHMARKS, and dates on other pages."""
    stated = {"command", "made", "commit", "machine"}
    kept = {name: {k: v for k, v in asdict(made[name]).items() if k in stated} for name in made}
    text = json.dumps(kept, indent=1, ensure_ascii=False, sort_keys=True)
    RESULTS.write_text(text + "\n", encoding="utf-8")
    there = [b for b in BENCHMARKS if b.name in made]
    OUTPUTS.mkdir(exist_ok=True)
    for path in OUTPUTS.glob("*.txt"):
        path.unlink()
    for b in there:
        file_of(b.name).write_text(output_file(b, made[b.name]), encoding="utf-8")
    rows = [table_row(b, made[b.name]) for b in there]
    PAGE.write_text("\n".join([HEAD, *rows, ""]), encoding="utf-8")
    dated = {file_of(b.name).name: citation(b.name, made[b.name]) for b in there}
    for page in PAGE.parent.glob("*.md"):
        text = page.read_text(encoding="utf-8")
        page.write_text(CITED.sub(lambda m: dated.get(m[1], m[0]), text), encoding="utf-8")


def citation(name: str, r: Result) -> str:
    """How other pages cite a row."""
    return f"[{r.made}, {r.commit}](benchmarks/{file_of(name).name})"


def output_file(b: Benchmark, r: Result) -> str:
    """The command, when and where it ran, what to know, what it printed."""
    about = textwrap.fill(r.about, 100, break_long_words=False, break_on_hyphens=False)
    where = r.machine or "a machine that was not written down"
    return (
        f"{b.name}\n\n{about}\n\n{r.command}\n"
        f"Made {r.made}, after {r.commit}, on {where}\n\n{RULE}\n{r.text}\n"
    )


def table_row(b: Benchmark, r: Result) -> str:
    """A row of the page: name, target, what came of it, day and commit, machine, command."""
    output = printed(r.text)
    target = targets(output) or re.findall(r"Target: (.*?)\.?$", r.about)
    last = headlines(output, b.last, b.heads) or ["see output"]
    cells = ["; ".join(dict.fromkeys(target)), "<br>".join(map(escaped, last))]
    link = f"[{b.name}](benchmarks/{file_of(b.name).name})"
    when = f"{r.made}, {r.commit}"
    return f"| {' | '.join([link, *cells, when, r.machine, f'`{r.command}`'])} |"


def escaped(line: str) -> str:
    """A line of an output in a cell of Markdown."""
    return re.sub(r"([|*_<`\[])", r"\\\1", line)


def now() -> tuple[str, str]:
    """The day, and the first commit on the way to this one that has its code and examples.

    A branch that changes neither names a commit that stays when others take its work.
    """
    words = ["git", "log", "--first-parent", "-1", "--format=%h", "--abbrev=8", "--"]
    told = subprocess.run(
        [*words, "src", "examples"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    return datetime.now(tz=timezone.utc).date().isoformat(), told.stdout.strip()


def main() -> int:
    """Run, and write each output as soon as it is there; others stay as they were."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", help="run the benchmarks whose name contains this")
    parser.add_argument("--write", action="store_true", help="only write the page")
    arguments = parser.parse_args()
    if arguments.write:
        write(results())
        return 0
    made, failed = results(), 0
    for b in BENCHMARKS:
        if arguments.only and arguments.only.lower() not in b.name.lower():
            continue
        print(f"== {b.name}", flush=True)
        when, words = now(), shlex.split(b.arguments)
        done = subprocess.run(
            [sys.executable, *words], cwd=ROOT, capture_output=True, text=True, check=False
        )
        failed += done.returncode != 0
        print(done.stdout + done.stderr, flush=True)
        if "Traceback (most recent call last)" in done.stderr:
            print("no figures: what is kept stays as it was", flush=True)
            continue
        text = f"```\n{done.stdout.rstrip()}\n```"
        about = made[b.name].about if b.name in made else first_lines(words[0])
        made[b.name] = Result(f"python {b.arguments}", *when, machine(), text, about)
        write(made)
    print(f"wrote {PAGE.relative_to(ROOT)}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
