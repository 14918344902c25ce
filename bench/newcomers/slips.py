"""What Soter says to newcomers: place right, remedy right, and whether its edit mends it.

    .venv/bin/python bench/newcomers/slips.py [--show PART] [--wrong]

Purpose: the slips of newcomer.txt, each an edit of a right program, with the place and the
remedy that were expected before Soter was asked. A place is right where the first message points
into the marked text; a remedy where what it says there (message, labels, notes, helps) matches. A
message is misleading where it offers a help and no line of it matches, or where an edit that it
offers leaves an error behind.
Non-goals: how the messages look (tests/golden), programs with several slips.
"""

from __future__ import annotations

import argparse
import re
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Severity
from soter.diagnostics.fixes import apply_fix
from soter.diagnostics.render import render
from soter.language.front_end import check_file

if TYPE_CHECKING:
    from soter.diagnostics.diagnostic import Diagnostic, Fix

HERE = Path(__file__).parent
OWN = ("newcomer_cart.soter", "newcomer_lib.soter", "newcomer_tests.soter")
FILES = tuple(p.name for p in sorted(HERE.glob("*.soter")))
STRANGERS = "THIRD SET, PEOPLE WHO HAD READ ONLY THE README"
LEAST = 104
FOURTH = "FOURTH SET, WRITTEN BEFORE IT WAS ASKED"
LATER = ("NOT SEEN BEFORE", "SECOND LOOK", STRANGERS, "THIRD SET, SEMANTICS", FOURTH)
"""Slips that were written when the messages were done, by others, or once more."""


@dataclass
class Slip:
    """One wrong program: edits of a right one, what should be said, and where."""

    name: str
    habit: str
    file: str = OWN[0]
    edits: list[tuple[str, str]] = field(default_factory=list)
    remedy: str = ""
    asked: str = ""
    """The file that is checked, where that is another one."""
    first: str = ""
    """What people said of the first answer: right, place_only, misleading, vague or silent."""

    def program(self) -> tuple[str, int, int]:
        """The text, and the offsets between which the message must point."""
        text = (HERE / self.file).read_text(encoding="utf-8")
        for old, new in self.edits:
            text, count = replaced(text, old, new)
            if count != 1:
                raise ValueError(f"{self.name}: {count} times in {self.file}: {old!r}")
        if text.count("\xab") != 1 or text.count("\xbb") != 1:
            raise ValueError(f"{self.name}: one place is marked")
        start, end = text.index("\xab"), text.index("\xbb") - 1
        return text.replace("\xab", "").replace("\xbb", ""), start, end


def replaced(text: str, old: str, new: str) -> tuple[str, int]:
    """Lines replaced, wherever they are indented; marks stand for nothing."""
    pattern = r"\s*\n\s*".join(re.escape(line.strip()) for line in old.split("\n"))
    return re.subn(rf"(?<![\w.]){pattern}", lambda _: new, text)


@dataclass
class Answer:
    """What was said first, and how it compares."""

    said: Diagnostic | None
    place: bool = False
    remedy: bool = False
    mended: list[bool] = field(default_factory=list)

    @property
    def misleading(self) -> bool:
        """It sends people the wrong way."""
        helped = self.said is not None and bool(self.said.helps)
        return (helped and not (self.remedy and self.place)) or not all(self.mended)


def slips() -> list[Slip]:
    """Those of the file, in its order."""
    entries: list[Slip] = []
    habit = ""
    old: list[str] = []
    new: list[str] = []
    for line in [*(HERE / "newcomer.txt").read_text(encoding="utf-8").split("\n"), ""]:
        if new and line[:1] != "+":
            entries[-1].edits.append(("\n".join(old), "\n".join(new)))
            old, new = [], []
        if line.startswith("= "):
            entries.append(Slip(line[2:], habit))
        elif line.startswith("file: "):
            entries[-1].file = line[6:]
        elif line.startswith("first: "):
            entries[-1].first = line[7:]
        elif line.startswith("asked: "):
            entries[-1].asked = line[7:]
        elif line.startswith("! "):
            entries[-1].first = line[2:]
        elif line.startswith("- "):
            old.append(line[2:])
        elif line.startswith("+ "):
            new.append(line[2:])
        elif line.startswith("? "):
            entries[-1].remedy = line[2:]
        elif line.isupper():
            habit = line
    return entries


def ask(slip: Slip, folder: Path) -> Answer:
    """What Soter says first, judged."""
    text, start, end = slip.program()
    path = folder / slip.file
    path.write_text(text, encoding="utf-8")
    asked = str(folder / (slip.asked or slip.file))
    checked = check_file(asked)
    said = next(iter(checked.diagnostics.items), None)
    answer = Answer(said)
    if said is not None:
        words = [said.message, *said.notes, *said.helps, *(x.text for x in said.secondary)]
        if said.primary is not None:
            span = said.primary.span
            words.append(said.primary.text)
            answer.place = span.source.name == str(path) and span.start <= end and span.end >= start
        answer.remedy = re.search(slip.remedy, "\n".join(words)) is not None
        answer.mended = [mends(fix, said.severity, asked) for fix in said.fixes]
    path.write_text((HERE / slip.file).read_text(encoding="utf-8"), encoding="utf-8")
    return answer


def mends(fix: Fix, severity: Severity, asked: str) -> bool:
    """Whether nothing as bad is said of the program after an edit."""
    texts = apply_fix(fix)
    before = {source: source.text for source in texts}
    for source, text in texts.items():
        Path(source.name).write_text(text, encoding="utf-8")
    diagnostics = check_file(asked).diagnostics.items
    for source, text in before.items():
        Path(source.name).write_text(text, encoding="utf-8")
    errors = [d for d in diagnostics if d.severity is Severity.ERROR]
    return not (errors or (severity is Severity.WARNING and diagnostics))


def main() -> int:
    """Ask and count; 1 where less than the target is reached."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--show", help="print what is said of the slips whose name has this in it")
    parser.add_argument("--wrong", action="store_true", help="print what is said where it is wrong")
    options = parser.parse_args()
    asked: list[tuple[Slip, Answer]] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for file in FILES:
            (folder / file).write_text((HERE / file).read_text(encoding="utf-8"), encoding="utf-8")
        for slip in slips():
            answer = ask(slip, folder)
            asked.append((slip, answer))
            wrong = answer.misleading or not (answer.place and answer.remedy)
            if (options.show and options.show in slip.name) or (options.wrong and wrong):
                print(f"=== {slip.name}  place {answer.place}, remedy {answer.remedy}")
                print(f"    expected {slip.remedy}; edits {answer.mended}; first {slip.first}")
                print(render(answer.said) if answer.said else "(silent)")
                print()
    return 0 if told(asked) else 1


def told(asked: list[tuple[Slip, Answer]]) -> bool:
    """The table; whether the targets are reached."""
    print(f"{'habit':<36} slips  place  remedy  both  misleading  edits  mend")
    rows = [*dict.fromkeys(slip.habit for slip, _ in asked), ""]
    for habit in rows:
        of = [a for s, a in asked if habit in ("", s.habit)]
        edits = [m for a in of for m in a.mended]
        print(
            f"{habit.lower() or 'all':<36} {len(of):>5}  {sum(a.place for a in of):>5}"
            f"  {sum(a.remedy for a in of):>6}  {sum(a.place and a.remedy for a in of):>4}"
            f"  {sum(a.misleading for a in of):>10}  {len(edits):>5}  {sum(edits):>4}"
        )
    for title, names in (
        ("misleading", [s.name for s, a in asked if a.misleading]),
        ("wrong or silent", [s.name for s, a in asked if not (a.place and a.remedy)]),
    ):
        print(f"{title}: {', '.join(names) or 'none'}")
    for who, habit in (("the strangers", STRANGERS), ("the fourth set", FOURTH)):
        of_set = [(s, a) for s, a in asked if s.habit == habit]
        print(
            f"of {len(of_set)} of {who}, right at first: "
            f"{sum(s.first == 'right' for s, _ in of_set)}, "
            f"now: {sum(a.place and a.remedy and not a.misleading for _, a in of_set)}"
        )
    before = [a for s, a in asked if s.habit not in LATER]
    right = sum(a.place and a.remedy for a in before)
    misleading = sum(a.misleading for a in before)
    print(
        f"place and remedy right: {right} of {len(before)} (target: {LEAST} of 108), misleading: "
        f"{misleading} (target: 0); without those not seen before"
    )
    return right / len(before) >= LEAST / 108 and not misleading


if __name__ == "__main__":
    sys.exit(main())
