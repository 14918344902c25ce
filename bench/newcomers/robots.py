"""Eight honest robots: proved at once, after what `verify` advises first, or not.

    .venv/bin/python bench/newcomers/robots.py [NAME ...]

Purpose: the programs of robots/, each written once, before it was verified. Where one is not
proved, what `verify` says first under `help` is done to it, as a person would: NAME.advice has the
line that it follows, which must be said, and the edits. Then it is verified again.
Non-goals: second advice; mistakes in a program (`slips.py`).
"""

from __future__ import annotations

import json
import re
import resource
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent / "robots"
ORDER = ("P2a", "ttf", "safer", "start", "P2b", "P1c", "P3")
"""Claims in the order in which `verify` tells of those that are not proved."""
LEAST = 6


@dataclass
class Answer:
    """What `soter verify` says of a program."""

    proved: bool
    advice: str
    cpu_s: float


def asked(program: Path) -> Answer:
    """`soter verify`, in a process of its own."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [sys.executable, "-m", "soter", "verify", str(program), "--json"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=program.parent)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    document = json.loads(done.stdout)
    return Answer(done.returncode == 0, first_advice(document), cpu_s)


def first_advice(document: dict[str, Any]) -> str:
    """The first `help` on the page; "" where there is none."""
    for module in document.get("modules", {}).values():
        for claim in ORDER:
            finding = module["properties"][claim]
            if finding["verdict"] not in ("proved", "assumed") and finding["hint"]:
                return str(finding["hint"])
    for diagnostic in document.get("diagnostics", []):
        if diagnostic["severity"] == "error" and diagnostic["helps"]:
            return str(diagnostic["helps"][0])
    return ""


def edited(text: str, advice: str) -> tuple[str, str]:
    """The program with the edits of a file of advice, and the line that it follows."""
    follows = ""
    old: list[str] = []
    for line in advice.splitlines():
        mark, rest = line[:1], line[2:]
        if mark == "?":
            follows = rest
        elif mark == "-":
            old.append(rest)
        elif mark == "+":
            text = replaced(text, "\n".join(old), rest)
            old = []
    return (replaced(text, "\n".join(old), "") if old else text), follows


def replaced(text: str, old: str, new: str) -> str:
    """Lines that stand there once, wherever they are indented, replaced."""
    pattern = r"\s*\n\s*".join(re.escape(line.strip()) for line in old.split("\n"))
    text, count = re.subn(pattern, lambda _: new, text)
    if count != 1:
        raise ValueError(f"{count} times: {old!r}")
    return text


def looked_at(program: Path, folder: Path) -> str:
    """One line of the table."""
    copy = folder / program.name
    copy.write_bytes(program.read_bytes())
    first = asked(copy)
    line = f"{program.stem:<14} {first.cpu_s:6.1f} s  "
    if first.proved:
        return line + "proved at once"
    advice = program.with_suffix(".advice")
    text, follows = edited(program.read_text("utf-8"), advice.read_text("utf-8"))
    if not follows or follows not in first.advice:
        return f"{line}NOT: it does not say {follows!r} but {first.advice!r}"
    copy.write_text(text, "utf-8")
    second = asked(copy)
    so = "proved after the first advice" if second.proved else "NOT after the first advice"
    then = "" if second.proved else f"; then: {second.advice[:90]}"
    return f"{line}{so}, {second.cpu_s:.1f} s: {follows}{then}"


def main() -> int:
    """Every robot, or those that are named."""
    programs = [p for p in sorted(HERE.glob("*.soter")) if p.stem in (sys.argv[1:] or [p.stem])]
    led = 0
    with tempfile.TemporaryDirectory() as folder:
        for program in programs:
            line = looked_at(program, Path(folder))
            led += "NOT" not in line
            print(line, flush=True)
    print(f"{led} of {len(programs)} proved, or the first advice leads there")
    return 0 if sys.argv[1:] or led >= LEAST else 1


if __name__ == "__main__":
    sys.exit(main())
