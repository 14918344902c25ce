"""Terminal sessions in the pages: the commands are run, and what they print stands below them.

Purpose: ```` ```console ```` blocks of a page as sessions; `differs` compares what was printed with
what a page shows, `shown` makes the text for a page. A line `…` stands for any lines, `…` in a line
for any letters; a last line `(exit code N)` for an exit code that is not 0. Lengths of gaps do not
count. Blocks of ```` ```soter file=NAME ```` are files of the session. With `long` behind the word
a block is run by `make test-all` only.
Non-goals: commands that wait for input.
"""

from __future__ import annotations

import os
import re
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path

import processes

ROOT = Path(__file__).resolve().parents[1]
CACHE = ROOT / "build" / "cache-of-pages"
FENCE = re.compile(r"^```(console[^\n]*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
FILE = re.compile(r"^```\w+ file=(\S+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
PROMPT = "$ "
LEFT_OUT = "…"
FIRST, LAST = 12, 4
"""Of long outputs so many lines are shown, and the rest of a table's row that they cut."""
COLUMNS = 110
NUMBER = r"\d[\d,.]*"
CHANGING = tuple(
    (re.compile(pattern), put)
    for pattern, put in (
        (rf"{NUMBER} (µs|ms|s|min) \({NUMBER} \u00d7 real time\)", "#"),
        (rf"^(\S+ +)(proved|assumed|confirmed)( +){NUMBER} (ms|s|min) ", r"\1\2\3# "),
        (rf"(PROVED .*  ){NUMBER} (ms|s|min)$", r"\1#"),
        (r"(\d transitions, depth \d+), .*", r"\1, #"),
        (rf"\b{NUMBER} s, {NUMBER} x real time", "#"),
        (rf"^(ACCEPTED .*  ){NUMBER} s$", r"\1#"),
        (r"─+", "─"),
        (rf"\b{NUMBER} (ns|us|MB|KB)\b", "#"),
        (r"\bwcet \d+us", "wcet #"),
        (r"\b\d+\.\d+ ms\b", "#"),
        (rf"\b{NUMBER}% busy", "# busy"),
        (r"^stack .*", "stack #"),
    )
)
"""What is another one in every run, on both sides of a comparison."""


@dataclass(frozen=True)
class Session:
    """A block: where it stands in the page's text, whether it is long, commands and outputs."""

    start: int
    end: int
    long: bool
    said: tuple[tuple[str, str], ...]


GOES_ON = re.compile(r" {16,}(?=\S)")
"""A line with the rest of a table's row, which depends on the width of the others."""
WRAPPED = re.compile(rf"\n{GOES_ON.pattern}")


def sessions(page: str) -> list[Session]:
    """The blocks of a page, in order."""
    blocks = []
    for match in FENCE.finditer(page):
        said: list[tuple[str, list[str]]] = []
        for line in match.group(2).splitlines():
            if line.startswith(PROMPT):
                said.append((line.removeprefix(PROMPT), []))
            elif said:
                said[-1][1].append(line)
        parts = tuple((c, "\n".join(lines).strip("\n")) for c, lines in said)
        blocks.append(Session(match.start(2), match.end(2), "long" in match.group(1), parts))
    return blocks


def files(page: str) -> dict[str, str]:
    """Name -> text of the files that a page shows."""
    return {m.group(1): m.group(2) for m in FILE.finditer(page)}


def folder_for(page: str, folder: Path) -> dict[str, str]:
    """Fill a folder as the root of the repository is; the environment for commands in it.

    What they compile is kept for all pages; a page shows what a machine says that has proved
    nothing yet.
    """
    for proof in CACHE.glob("proof-*"):
        shutil.rmtree(proof, ignore_errors=True)  # another page may be at it
    shutil.copytree(ROOT / "examples", folder / "examples")
    for name, text in files(page).items():
        (folder / name).write_text(text, encoding="utf-8")
    tools = f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', '')}"
    own = {"PATH": tools, "SOTER_CACHE": str(CACHE), "COLUMNS": str(COLUMNS)}
    return {**os.environ, **own, "NO_COLOR": "1", "PYTHONUTF8": "1"}


PROGRESS = r"^soter: [0-9]+ s(  .*)?\n"
"""What a command writes every ten seconds, where it takes that long."""


def printed(command: str, folder: Path, environment: dict[str, str]) -> str:
    """What a command prints, on both streams, with its exit code where that is not 0."""
    plain = re.split(r"\s{2,}# ", command)[0]
    done = processes.run(
        ["bash", "-c", f"exec 2>&1; {plain}"],
        cwd=folder,
        env=environment,
        stdout=processes.PIPE,
        text=True,
    )
    text = re.sub(PROGRESS, "", str(done.stdout), flags=re.MULTILINE).strip("\n")
    code = f"\n(exit code {done.returncode})" if done.returncode else ""
    return "\n".join(line.rstrip() for line in text.splitlines()) + code


def differs(output: str, expected: str) -> str:
    """What of `expected` is not in what was printed; empty where it is all there."""
    parts, told = [], _steady(output)
    for line in _steady(expected).splitlines():
        if line.strip() == LEFT_OUT:
            parts.append(r"(?:[^\n]*\n)*?")
        else:
            words = [re.escape(w).replace(LEFT_OUT, r"[^\n]*?") for w in line.split()]
            parts.append(r"[ \t]*" + r"[ \t]+".join(words) + r"[ \t]*\n")
    if re.fullmatch("".join(parts), f"{told}\n" if told else ""):
        return ""
    return f"the page shows\n{expected}\nbut it prints\n{output}"


def _steady(text: str) -> str:
    """Without what changes."""
    lines = text.splitlines()
    for pattern, put in CHANGING:
        lines = [pattern.sub(put, line) for line in lines]
    return WRAPPED.sub(" ", "\n".join(lines))


def shown(output: str) -> str:
    """An output as a page shows it: shortened."""
    lines = output.splitlines()
    fence = next((i for i, line in enumerate(lines) if line.startswith("```")), None)
    if fence is not None:
        lines = [*lines[:fence], LEFT_OUT]  # it would end the block
    begin, end = FIRST, len(lines) - LAST
    while begin < end and GOES_ON.match(lines[begin]):
        begin += 1
    while begin < end and GOES_ON.match(lines[end]):
        end -= 1
    if begin + 1 < end:
        lines = [*lines[:begin], LEFT_OUT, *lines[end:]]
    return "\n".join(lines)


def renewed(page: str, outputs: dict[int, list[str]]) -> str:
    """The page with the outputs of its sessions, by start, where they no longer fit."""
    for s in reversed(sessions(page)):
        if s.start not in outputs:
            continue
        lines = []
        for (command, expected), output in zip(s.said, outputs[s.start], strict=True):
            fits = expected and not differs(output, expected)
            lines += [PROMPT + command, expected if fits else shown(output)]
        page = page[: s.start] + "\n".join(x for x in lines if x) + "\n" + page[s.end :]
    return page
