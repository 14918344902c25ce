"""What others rely on is what is recorded, and what goes stands in the changelog.

`public_surface.py` reads the surface off the package; its record is `public_surface.txt`, and that
of a release lies in the folder of its version. Grammar, and the versions of files, are promised by
what is read (`test_files_of_released_versions.py`), not by their words.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from public_surface import HEADERS, RECORD, ROOT, SECTIONS, recorded, surface, text_of
from soter.version import VERSION

HERE = Path(__file__).parent
RELEASES = sorted(path.parent.name for path in HERE.glob("*/public_surface.txt"))
BY_READING = {"grammar", "versions of files"}
REMEDY = """
Where nothing is gone or changed: `python tests/public_surface.py` writes the record.
Where something is: it was promised (docs/stability.md). Keep it, or say under "What you must do" of
CHANGELOG.md what whoever used it has to do, raise the version, and write the record then."""


@pytest.fixture(scope="module")
def now() -> dict[str, list[str]]:
    pytest.importorskip("gymnasium", reason="`soter.gym` is a part of the surface")
    return surface()


def changes(before: dict[str, list[str]], after: dict[str, list[str]]) -> list[str]:
    """What is gone and what is new, a sentence each."""
    told = []
    for kind in SECTIONS:
        then, today = dict.fromkeys(before.get(kind, ())), dict.fromkeys(after.get(kind, ()))
        told += [f"{kind}: gone or changed: {line}" for line in then if line not in today]
        told += [f"{kind}: new or changed: {line}" for line in today if line not in then]
    return told


def promise(kind: str, line: str) -> str:
    """What of a line stays from release to release: defaults, and words of a list, may change."""
    if kind == "JSON documents":
        name, _, of = line.replace("?:", ":").partition(": ")
        return f"{name}: one of its words" if set(of) & {chr(34), "|"} else f"{name}: {of}"
    return line if kind == "C interface" else re.split(" nargs | = ", line)[0]


def gone(before: dict[str, list[str]], after: dict[str, list[str]]) -> list[str]:
    """What a released surface promised; grammar and files are held by reading what is written."""
    kinds = SECTIONS.keys() - BY_READING
    kept = {kind: {promise(kind, line) for line in after[kind]} for kind in kinds}
    promised = {kind: dict.fromkeys(promise(kind, line) for line in before[kind]) for kind in kinds}
    return [words for kind in kinds for words in promised[kind] if words not in kept[kind]]


def test_the_surface_is_the_recorded_one(now: dict[str, list[str]]) -> None:
    told = changes(recorded(RECORD.read_text(encoding="utf-8")), now)
    assert not told, "\n".join(("the public surface is another one:", *told, REMEDY))


def test_a_record_is_read_as_it_was_written(now: dict[str, list[str]]) -> None:
    assert recorded(text_of(now)) == now
    assert all(now.values())


@pytest.mark.parametrize("kind", SECTIONS)
def test_a_change_of_every_kind_is_told(now: dict[str, list[str]], kind: str) -> None:
    """A line less, a line more and another line are each told, with the line and its kind."""
    first, *others = now[kind]
    less, other = {**now, kind: others}, {**now, kind: [f"{first} other", *others]}
    assert changes(now, less) == [f"{kind}: gone or changed: {first}"]
    assert changes(less, now) == [f"{kind}: new or changed: {first}"]
    assert len(changes(now, other)) == 2
    assert gone(now, less) == ([] if kind in BY_READING else [promise(kind, first)])


@pytest.mark.parametrize("release", RELEASES)
def test_what_went_since_a_release_stands_in_the_changelog(
    release: str, now: dict[str, list[str]]
) -> None:
    """What a release promised is there, or the changelog names it and says what became of it."""
    then = recorded((HERE / release / "public_surface.txt").read_text(encoding="utf-8"))
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    newer, heading, _ = changelog.partition(f"\n## {release}\n")
    lost = gone(then, now)
    untold = [words for words in lost if words.split(": ")[0] not in newer]
    assert not untold, f"gone since {release}, and not in CHANGELOG.md: {untold}{REMEDY}"
    if heading and lost:
        assert version(VERSION) > version(release), f"{lost} went: raise the version"


def test_the_page_says_what_is_recorded(now: dict[str, list[str]]) -> None:
    """Headers and versions of files on docs/stability.md are those of today."""
    page = (ROOT / "docs" / "stability.md").read_text(encoding="utf-8")
    assert [name for name in HEADERS if f"`{Path(name).name}`" not in page] == []
    numbers = dict(line.split(": ") for line in now["versions of files"])
    rows = {
        "certificate": "Certificates",
        "trace": "Traces",
        "campaign.json": "Folders of campaigns",
    }
    rows |= {"channels.json": "Files of times, channels.json", "JSON documents": "JSON documents"}
    for file, row in rows.items():
        (said,) = (line for line in page.splitlines() if line.startswith(f"| **{row}**"))
        assert said.endswith(f"{numbers[file]} |"), file


def version(text: str) -> tuple[int, ...]:
    """The numbers of a version."""
    return tuple(int(part) for part in re.findall(r"\d+", text)[:3])
