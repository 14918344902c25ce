"""100 tests with wide steps: whether they end when told to, and none says clean.

    .venv/bin/python bench/testing/wide.py [--tests N] [--after SECONDS] [--json FILE]

Each program does something wide (choices in a step, topics, words, enums, inputs, starts), and each
has an execution that violates its property, mostly one in astronomically many: so *clean* is wrong.
Each is searched twice: with `--time`, and in a process that gets SIGINT or SIGTERM in the middle of
it. What is measured is how long either takes to answer with what was covered.

Purpose: the wide half of the first figure of issue 11. Non-goals: how fast it searches.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from soter.report.terminal_tables import table

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

ANSWER_S = 1.0
TIME_S = 0.3
"""Of the search that is bounded."""
PATIENCE_S = 60.0
"""After it, a process that was told to end hangs."""
OUTPUTS = 32
"""Topics of one node."""


def _counted(k: int) -> str:
    """K choices that end in few configurations."""
    asked = " ".join(f"if choose bool {{ s = min(s + 1, {k}); }}" for _ in range(k))
    return f"""topic n: int in [0, {k}];
node W period 10ms {{ publishes n; step {{ var s: int = 0; {asked} publish n = s; }} }}
system S {{ w: W; until 100ms; }} test T {{ system S; horizon 30ms; never n == {k}; }}"""


def _distinct(k: int) -> str:
    """K choices that end in 2^k configurations."""
    values = ", ".join(["choose bool"] * k)
    every = " && ".join(f"t[{i}]" for i in range(k))
    return f"""topic t: bool[{k}];
node W period 10ms {{ publishes t; step {{ publish t = [{values}]; }} }}
system S {{ w: W; until 100ms; }} test T {{ system S; horizon 30ms; never {every}; }}"""


def _topics(k: int) -> str:
    """K topics, as many of a node as there may be."""
    nodes = range(-(-k // OUTPUTS))
    text = "".join(f"topic t{i}: bool;\n" for i in range(k))
    for n in nodes:
        own = range(n * OUTPUTS, min(k, (n + 1) * OUTPUTS))
        steps = " ".join(f"publish t{i} = choose bool;" for i in own)
        names = ", ".join(f"t{i}" for i in own)
        text += f"node W{n} period 10ms {{ publishes {names}; step {{ {steps} }} }}\n"
    every = " && ".join(f"t{i}" for i in range(k))
    inside = " ".join(f"w{n}: W{n};" for n in nodes)
    test = f"test T {{ system S; horizon 30ms; never {every}; }}"
    return f"{text}system S {{ {inside} until 100ms; }} {test}"


def _words(k: int) -> str:
    """Configurations of some 60 k words, also more than there is room for."""
    size = 60 * k
    zeros = ", ".join(["0.0"] * size)
    return f"""topic n: int in [0, 9];
node W period 10ms {{ publishes n; var a: float[{size}] = [{zeros}];
  step {{ let i: int = choose [0, {min(size, 1024) - 1}]; a[i] = a[i] + 1.0;
    publish n = choose [0, 9]; }} }}
node V period 10ms {{ subscribes n; publishes m; var c: int in [0, 900] = 0;
  step {{ c = c + n; publish m = c; }} }}
topic m: int in [0, 900];
system S {{ w: W; v: V; until 200ms; }} test T {{ system S; horizon 90ms; never m == 81; }}"""


def _enums(k: int) -> str:
    """Enums of 30 k members, three drawn at once."""
    members = ", ".join(f"M{i}" for i in range(30 * k))
    last = f"E.M{30 * k - 1}"
    fields = ("a", "b", "c", "d")
    topics = "".join(f"topic {f}: E;\n" for f in fields)
    steps = " ".join(f"publish {f} = choose E;" for f in fields)
    every = " && ".join(f"{f} == {last}" for f in fields)
    return f"""type E = enum {{ {members} }};
{topics}node W period 10ms {{ publishes {", ".join(fields)}; step {{ {steps} }} }}
system S {{ w: W; until 100ms; }} test T {{ system S; horizon 30ms; never {every}; }}"""


def _inputs(k: int) -> str:
    """K inputs of a million values each."""
    topics = "".join(f"input topic x{i}: int in [0, 1000000];\n" for i in range(k))
    drives = " ".join(f"input x{i} every 10ms;" for i in range(k))
    every = " && ".join(f"x{i} == 1000000" for i in range(k))
    names = ", ".join(f"x{i}" for i in range(k))
    return f"""{topics}topic y: bool;
node W period 10ms {{ subscribes {names}; publishes y; step {{ publish y = {every}; }} }}
system S {{ w: W; {drives} until 100ms; }} test T {{ system S; horizon 30ms; never y; }}"""


def _starts(k: int) -> str:
    """A plant that starts anywhere, in k dimensions."""
    states = "".join(f"state a{i}: float in [-1.0, 1.0]; next a{i} = a{i};\n" for i in range(k))
    every = " && ".join(f"p.truth.a{i} == 1.0" for i in range(k))
    return f"""topic pos: float;
plant P period 10ms {{ drives pos = a0;
{states}}}
system S {{ p: P; until 100ms; }} test T {{ system S; horizon 30ms; never {every}; }}"""


FAMILIES: dict[str, tuple[Callable[[int], str], tuple[int, ...]]] = {
    "choices, few results": (_counted, tuple(range(30, 135, 7))),
    "choices, all distinct": (_distinct, tuple(range(22, 127, 7))),
    "topics": (_topics, tuple(range(24, 104, 5))[:15]),
    "words": (_words, tuple(range(1, 76, 5))),
    "enums": (_enums, tuple(range(4, 34, 2))),
    "inputs": (_inputs, tuple(range(2, 17))),
    "starts": (_starts, tuple(range(16, 66, 5))),
}


@dataclass
class Case:
    """A test: its verdicts with a bound on time and with a signal, and seconds to the answers."""

    family: str
    size: int
    bounded: str
    bounded_s: float
    signal: str
    stopped: str
    answered_s: float
    covered: bool

    @property
    def hung(self) -> bool:
        """Whether it did not end by itself."""
        return "hung" in (self.bounded, self.stopped)


def _verdict(out: str) -> tuple[str, float, bool]:
    """Verdict with its bound, seconds, and whether it says what was covered."""
    (test,) = json.loads(out)["tests"]
    said = test["verdict"] if test["bound"] is None else test["bound"]
    return said, test["seconds"], test["transitions"] > 0 or test["states"] > 0


def _command(file: Path, *more: str) -> list[str]:
    tail = ("--json", "--minimise", "0", "-o", str(file.parent / "out"))
    return [sys.executable, "-m", "soter.cli.main", "test", str(file), *more, *tail]


def _wait_until_it_searches(running: subprocess.Popen[str]) -> None:
    """A search has a thread of its own."""
    tasks = Path(f"/proc/{running.pid}/task")
    until = time.perf_counter() + PATIENCE_S
    while running.poll() is None and time.perf_counter() < until:
        if tasks.is_dir() and len(list(tasks.iterdir())) > 1:
            return
        time.sleep(0.05)


def _measured(family: str, size: int, file: Path, number: signal.Signals, after_s: float) -> Case:
    bounded, bounded_s = "hung", PATIENCE_S
    with_time = _command(file, "--time", str(TIME_S))
    try:  # compiles, too
        done = subprocess.run(with_time, capture_output=True, text=True, timeout=600, check=False)
        bounded, bounded_s, _ = _verdict(done.stdout)
    except subprocess.TimeoutExpired:
        pass
    one = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    running = subprocess.Popen(_command(file), stdout=subprocess.PIPE, text=True, env=one)
    _wait_until_it_searches(running)
    time.sleep(after_s)
    ended = running.poll() is not None
    began = time.perf_counter()
    if not ended:
        running.send_signal(number)
    try:
        out, _ = running.communicate(timeout=PATIENCE_S)
    except subprocess.TimeoutExpired:
        os.kill(running.pid, signal.SIGKILL)
        running.communicate()
        stopped, covered = "hung", False
    else:
        stopped, _, covered = _verdict(out)
    waited = 0.0 if ended else time.perf_counter() - began
    name = "" if ended else number.name
    return Case(family, size, bounded, bounded_s, name, stopped, waited, covered)


def cases(most: int, after_s: float) -> Iterator[Case]:
    """All of them, one after the other; SIGINT and SIGTERM by turns."""
    wanted = [(name, make, k) for name, (make, sizes) in FAMILIES.items() for k in sizes]
    with tempfile.TemporaryDirectory() as folder:
        for i, (name, make, k) in enumerate(wanted[:: max(1, len(wanted) // most)][:most]):
            file = Path(folder) / f"wide{i}.soter"
            file.write_text("soter 1;\n" + make(k) + "\n", encoding="utf-8")
            number = (signal.SIGINT, signal.SIGTERM)[i % 2]
            yield _measured(name, k, file, number, after_s)


def report(outcomes: list[Case]) -> str:
    """A line a family."""
    rows = []
    for family in dict.fromkeys(c.family for c in outcomes):
        own = [c for c in outcomes if c.family == family]
        told = [c for c in own if c.signal]
        verdicts = Counter(c.stopped for c in own)
        rows.append(
            [
                family,
                f"{min(c.size for c in own)} to {max(c.size for c in own)}",
                str(len(own)),
                ", ".join(f"{n} {v}" for v, n in verdicts.most_common()),
                f"{max((c.answered_s for c in told), default=0.0):.2f} s",
                f"{max(c.bounded_s for c in own) - TIME_S:+.2f} s",
                str(sum(c.hung for c in own)),
                str(sum("exhausted" in (c.bounded, c.stopped) for c in own)),
            ]
        )
    head = ["wide", "size", "tests", "verdicts", "slowest answer", "over --time", "hung", "clean"]
    return table(head, rows)


def failures(outcomes: list[Case]) -> list[str]:
    """What misses its target."""
    bad = []
    for c in outcomes:
        name = f"{c.family} {c.size}"
        if c.hung or c.answered_s > ANSWER_S:
            bad.append(f"{name}: {c.signal} answered after {c.answered_s:.2f} s")
        if c.bounded_s > TIME_S + ANSWER_S:
            bad.append(f"{name}: --time {TIME_S} took {c.bounded_s:.2f} s")
        if "exhausted" in (c.bounded, c.stopped):
            bad.append(f"{name}: said to be clean")
        if not c.covered and c.stopped != "width":
            bad.append(f"{name}: says nothing of what was covered")
    return bad


def main() -> int:
    """The table; 1 where a target is missed."""
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("--tests", type=int, default=100)
    parser.add_argument(
        "--after", type=float, default=1.0, help="seconds of searching, then comes the signal"
    )
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's `&` has it ignored
    outcomes = []
    for case in cases(args.tests, args.after):
        outcomes.append(case)
        print(f"{len(outcomes):3} {case.family} {case.size}: {case.stopped}", file=sys.stderr)
    print(report(outcomes))
    bad = failures(outcomes)
    print(
        "\n".join(bad)
        if bad
        else f"{len(outcomes)} tests: 0 hung, 0 clean, answers in {ANSWER_S:g} s"
    )
    if args.json is not None:
        args.json.write_text(json.dumps([asdict(c) for c in outcomes], indent=1), encoding="utf-8")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
