"""Honest robots as they stand: what `soter verify` says, what it advises then, and `recheck`.

    .venv/bin/python bench/newcomers/first_attempt.py [--folder ../shared/robots]
        [--without-hints] [--rests FILE] [--recheck-below S] [--kept .soter/newcomers] [NAME ...]

Purpose: a row a program: proved in full or what is not, CPU seconds of both commands, and whether
the certificate is accepted. Where it is not proved, what `help` says that was tried is done, as it
is written there, and it is asked again, four times at most. `--recheck-below`: certificates of
proofs that took more CPU seconds are not re-checked, and the table says so. `--without-hints`: what
hints at a proof is taken out first, and nothing is followed: the search alone has to find it.
*Proved*: every claim, or *decided in flight* with P2a and the start proved. Answers are kept, by
program and the tool's sources: the next call goes on. `--rests`: hints are taken out, too, and what
the file has of a program is written into it: a `rest`, and sets of topics.
Non-goals: advice that was not tried, or that no edit of the printed words carries out; wrong
variants (`wrong_robots.py`).
"""

from __future__ import annotations

import argparse
import hashlib
import json
import re
import resource
import subprocess
import sys
import tempfile
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

ROOT = Path(__file__).resolve().parents[2]
LONGEST_S = 900.0
"""CPU seconds that a command may take."""
BUDGET = "300s"
"""Of the search for hints."""
HINTS = ("grid", "core", "levels", "ttf", "safer", "shield", "rest")
"""The words with which items begin that `--without-hints` takes out of modules."""
HELD = ("proved", "decided in flight")
ATTEMPTS = 4
"""So often the advice is followed at most."""
TRIED = " (tried: "
HEAD = "| robot | at the first attempt | CPU s | recheck | CPU s | by what is printed | CPU s | "
HEAD += "recheck | CPU s |"


@dataclass(frozen=True)
class Answer:
    """What the commands say of a program."""

    verdict: str
    cpu_s: float
    again: str
    """Of `recheck`, "-" where there is nothing to check again."""
    again_s: float
    advice: str
    """The first `help` that was tried, without what came of it."""


def run(*arguments: str, folder: Path) -> tuple[dict[str, Any], float]:
    """The document of a command, {} where it took too long, and its CPU seconds."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)

    def limited() -> None:
        resource.setrlimit(resource.RLIMIT_CPU, (int(LONGEST_S), int(LONGEST_S) + 5))

    command = [sys.executable, "-m", "soter", *arguments, "--json"]
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, cwd=folder, preexec_fn=limited
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return json.loads(done.stdout) if done.stdout.strip() else {}, cpu_s


def said(document: dict[str, Any]) -> str:
    """The verdict: what is not proved of it, or the code of what was refused."""
    if not document:
        return f"no verdict in {LONGEST_S:.0f} s"
    errors = [d["code"] for d in document.get("diagnostics", []) if d["severity"] == "error"]
    if errors:
        return f"error {errors[0]}"
    verdicts = []
    for module in document["modules"].values():
        claims = {c: f["verdict"] for c, f in module["properties"].items()}
        open_ = [c for c, verdict in claims.items() if verdict == "undecided"]
        if module["verdict"] == "assumed" and claims["P2a"] == claims["start"] == "proved":
            verdicts.append(HELD[1])
            continue
        undecided = module["verdict"] == "undecided" and open_
        verdicts.append(f"undecided: {', '.join(open_)}" if undecided else str(module["verdict"]))
    return "; ".join(verdicts)


def advised(document: dict[str, Any]) -> str:
    """The first advice that was tried, "" where there is none."""
    for module in document.get("modules", {}).values():
        for finding in module["properties"].values():
            if TRIED in (finding["hint"] or ""):
                return str(finding["hint"].partition(TRIED)[0])
    return ""


def followed(text: str, advice: str) -> str:
    """The program with what is advised written into it; the same where nothing can be."""
    grids = re.findall(r"`(grid .*?;)`", advice)
    if grids:
        text = re.sub(r"(verify \{ ?)(?:grid [^;]*;\s*)+", rf"\1{grids[-1]} ", text)
    for age, topic in re.findall(r"`max_age (\w+)` of `(\w+)`", advice):
        text = re.sub(rf"(topic {topic}:.*?max_age )\w+", rf"\g<1>{age}", text)
    for ac, sc in re.findall(r"`ac (\w+); sc (\w+);`", advice):
        text = re.sub(r"\bac \w+;(\s*)sc \w+;", rf"ac {ac};\1sc {sc};", text)
    if "neither `ttf` nor `safer`" in advice:
        text = re.sub(r"\b(?:ttf|safer) [^;]*;\s*", "", text)
    return text


def without_hints(text: str) -> str:
    """The program with nothing in its modules that hints at a proof."""
    text = re.sub(r"//[^\n]*", "", text)
    head, *modules = re.split(r"(?=\brta \w+ *\{)", text)
    words = "|".join(HINTS)
    for k, module in enumerate(modules):
        parts = re.fullmatch(r"(.*?\n\}|.*\})(.*)", module, re.DOTALL)
        assert parts is not None
        body, rest = parts.groups()
        body = re.sub(rf"(?<=[;{{]|\s)(?:{words})\b[^;]*;", "", body)
        modules[k] = re.sub(r"verify \{\s*\}", "", body) + rest
    return head + "".join(modules)


def with_rest(name: str, text: str, lines: list[str]) -> str:
    """The program without hints, with the `rest` and the sets of topics that the lines give it."""
    text = without_hints(text)
    for line in lines:
        of, _, given = line.partition(": ")
        if of == name:
            text = re.sub(r"(\n\s*safe [^;]*;)", rf"\1\n  {given}", text, count=1)
        elif of.startswith(f"{name} topic "):
            topic = of.split()[-1]
            text = re.sub(rf"(topic {topic}:.*?) max_age", rf"\1 in {{ {given} }} max_age", text)
    return text


def answered(name: str, text: str, recheck_below_s: float, budget: str) -> dict[str, Any]:
    """What `verify` says of a program, and `recheck` of its certificate: an `Answer`."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        (folder / f"{name}.soter").write_text(text)
        command = ("verify", f"{name}.soter", "--cert", "proof", "--budget", budget)
        document, cpu_s = run(*command, folder=folder)
        verdict, again, again_s = said(document), "-", 0.0
        if verdict in HELD and cpu_s > recheck_below_s:
            again = f"not asked: the proof took more than {recheck_below_s:.0f} s"
        elif verdict in HELD:
            checked, again_s = run("recheck", "proof", folder=folder)
            again = str(checked.get("verdict", f"no verdict in {LONGEST_S:.0f} s"))
    return asdict(Answer(verdict, cpu_s, again, again_s, advised(document)))


def kept(
    folder: Path, about: tuple[str, ...], make: Callable[[], dict[str, Any]]
) -> dict[str, Any]:
    """What `make` says, from the file of an earlier call where there is one."""
    file = folder / hashlib.sha256("\n".join(about).encode()).hexdigest()[:16]
    if not file.exists():
        folder.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps(make()))
    said_then: dict[str, Any] = json.loads(file.read_text())
    return said_then


def tool() -> str:
    """The tree of the tool's sources."""
    command = ["git", "rev-parse", "HEAD:src"]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout


def cells(answer: Answer) -> str:
    """Four columns."""
    again_s = f"{answer.again_s:.0f}" if answer.again_s else "-"
    return f" {answer.verdict} | {answer.cpu_s:.0f} | {answer.again} | {again_s} |"


def main(argv: list[str]) -> int:
    """0."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--folder", type=Path, default=ROOT.parent / "shared" / "robots")
    parser.add_argument("--without-hints", action="store_true")
    parser.add_argument("--rests", type=Path)
    parser.add_argument("--recheck-below", type=float, default=LONGEST_S)
    parser.add_argument("--kept", type=Path, default=ROOT / ".soter" / "newcomers")
    parser.add_argument("names", nargs="*")
    options = parser.parse_args(argv)
    programs = sorted(options.folder.glob("*.soter"))
    paths = [p for p in programs if not options.names or p.stem in options.names]
    below, sources = options.recheck_below, tool()
    rests = options.rests.read_text().splitlines() if options.rests else []
    budget, alone = "0s" if rests else BUDGET, bool(rests or options.without_hints)
    firsts, lasts, steps = [], [], []
    print(f"{HEAD}\n|{'---|' * (HEAD.count('|') - 1)}")
    for path in paths:
        text, done = path.read_text(), list[str]()
        text = without_hints(text) if options.without_hints else text
        text = with_rest(path.stem, text, rests) if rests else text
        while True:
            about = (path.stem, text, str(below), budget, sources)
            made = kept(options.kept, about, partial(answered, path.stem, text, below, budget))
            answer = Answer(**made)
            firsts += [] if done else [answer]
            again = followed(text, answer.advice)
            held = answer.verdict in HELD or alone
            if held or again == text or len(done) == ATTEMPTS:
                break
            text = again
            done.append(answer.advice)
        lasts.append(answer)
        row = f"| {path.stem} |{cells(firsts[-1])}{cells(answer) if done else ' - | - | - | - |'}"
        print(row, flush=True)
        steps += [f"{path.stem}: {'; then '.join(done)}"] if done else []
    print("\nWhat was done: " + ("; ".join(steps) or "nothing") + ".")
    for when, answers in (("at the first attempt", firsts), ("by what is printed", lasts)):
        proved = [a for a in answers if a.verdict in HELD]
        accepted = sum(a.again == "accepted" for a in proved)
        unasked = sum(a.again.startswith("not asked") for a in proved)
        print(
            f"\n{len(proved)} of {len(paths)} proved {when}, {accepted} of these accepted"
            + (f", {unasked} not re-checked" if unasked else "")
        )
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
