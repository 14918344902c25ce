"""Files that mean harm, 30 of each format: what is executed, read or written elsewhere, and costs.

    .venv/bin/python bench/hostile/hostile_files.py [--only FORMAT,...] [--each N] [--seed 1]

Purpose: of every format a file in place of a good one: no ordinary file, a link to a file outside
of its folder, a file of another kind that runs, unpacks or grows where somebody trusts it, the good
one with code, paths and markup where words stood (also inside of what is packed), and what harms in
its own words (`hostile_crafted.py`). Each command reads it in a process that may take 2 GiB more
than it has, for 60 s. Counted is what may never be: a mark that only executed code makes, a change
outside of the folder, a secret from outside in what the command says or writes. A link that stands
on the command line is the user's own: there it is read.
Non-goals: bits that flip (`bad_input.py`); programs that bind externs, which run them
(docs/what-runs.md).
"""

from __future__ import annotations

import argparse
import gzip
import io
import os
import pickle
import re
import sqlite3
import sys
import tempfile
import zipfile
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from bench.hostile import bad_input_commands  # noqa: E402 - needs the path
from bench.hostile.bad_input_commands import Forked, Tried  # noqa: E402
from bench.hostile.bad_input_mutants import NO_STREAM, SPECIAL  # noqa: E402
from bench.hostile.bad_input_samples import Format, formats, samples  # noqa: E402
from bench.hostile.hostile_crafted import CRAFTED, RUNS, Runs, repacked  # noqa: E402
from bench.hostile.hostile_samples import CALLS, MORE, more_samples  # noqa: E402

if TYPE_CHECKING:
    from collections.abc import Callable

EACH = 30
LIMIT_S, MEMORY = 60.0, 2 * 2**30
SECRET = "not-for-strangers-7c1f"  # noqa: S105 - a mark
RAN = "ran"
SHELL = RUNS
WORDS: tuple[str, ...] = (
    f"__import__('os').system('{SHELL}')",
    f"$({SHELL})",
    f"`{SHELL}`",
    f'"; {SHELL}; "',
    f'*/ system("{SHELL}"); /*',
    f'!!python/object/apply:os.system ["{SHELL}"]',
    "../outside/secret",
    "{outside}/secret",
    "file://{outside}/secret",
)
"""What stands where a word stood."""
WORD = re.compile(rb"[A-Za-z_][\w.]*")
COLUMNS = ("executed", "written outside", "read outside", "over 2 GiB", "over 60 s", "defects")


def _npy() -> bytes:
    stream = io.BytesIO()
    np.save(stream, np.array([Runs()], dtype=object), allow_pickle=True)
    return stream.getvalue()


def _zip(parts: dict[str, bytes]) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as made:
        for name, data in parts.items():
            made.writestr(name, data)
    return stream.getvalue()


def _database() -> bytes:
    """A bag whose table is a view, with a trigger, beside an extension to load."""
    made = sqlite3.connect(":memory:")
    made.executescript(
        "CREATE TABLE topics(id, name, type, serialization_format, offered_qos_profiles);"
        "CREATE VIEW messages AS SELECT load_extension('../outside/secret') AS data, 1 AS topic_id,"
        " randomblob(1000000000) AS timestamp, 1 AS id;"
    )
    return made.serialize() if hasattr(made, "serialize") else b"SQLite format 3\0"


ENTITIES = "".join(f'<!ENTITY a{k + 1} "{f"&a{k};" * 10}">' for k in range(9))
CONTENTS: dict[str, Callable[[], bytes]] = {
    "a pickle that runs": lambda: pickle.dumps(Runs()),
    "an array of objects that run": _npy,
    "a zip that unpacks elsewhere": lambda: _zip({"../outside/new": b"x", "/tmp/new": b"x"}),  # noqa: S108
    "a zip of 2 GiB": lambda: _zip({"data": bytes(2**31), "policy.pth": bytes(2**20)}),
    "a gzip of 4 GiB": lambda: gzip.compress(bytes(2**22)) * 1024,
    "a database that computes": _database,
    "XML that grows": f'<!DOCTYPE a [<!ENTITY a0 "a">{ENTITIES}]><a>&a9;</a>'.encode,
    "YAML that grows": lambda: "".join(
        ["a0: &a0 [x,x]\n", *(f"a{k + 1}: &a{k + 1} [{f'*a{k},' * 9}]\n" for k in range(9))]
    ).encode(),
    "brackets without end": lambda: b"[{(" * 10**6,
}
"""Whole files of another kind, whatever the format is."""
LINK = "a link to what lies outside"
_made: dict[str, bytes] = {}


def number_of(one: Format) -> int:
    """How many hostile files there are of a format."""
    return EACH + len(CRAFTED.get(one.name, ()))


def chosen(one: Format, each: int | None) -> list[int]:
    """Which of them are tried."""
    of = number_of(one)
    return (
        list(range(of))
        if each is None
        else [of * (i + 1) // each - 1 for i in range(min(each, of))]
    )


def hostile(one: Format, k: int, chance: Random, folder: Path, outside: Path) -> str:
    """Put hostile file `k` of a format in its place; what it is, in words."""
    if k >= EACH:
        what, put = CRAFTED[one.name][k - EACH]
        put(folder, outside)
        return what
    path = folder / one.files[k % len(one.files)]
    kinds = [n for n in (*SPECIAL, LINK, *CONTENTS) if not one.stdin or n not in NO_STREAM]
    if k >= len(kinds):
        word = chance.choice(WORDS).replace("{outside}", str(outside)).encode()
        path.write_bytes(_worded(path.read_bytes(), word, chance))
        return f"{path.name}: {word.decode()}"
    kind = kinds[k]
    path.unlink()
    if kind in CONTENTS:
        path.write_bytes(_made.setdefault(kind, CONTENTS[kind]()))
    elif kind in SPECIAL:
        SPECIAL[kind](path)
    else:
        path.symlink_to(outside / "secret")
    return f"{path.name} is {kind}"


def _worded(raw: bytes, word: bytes, chance: Random) -> bytes:
    """A file in which a word stands where others stood; inside of what is packed."""
    if raw.startswith(b"\x1f\x8b"):
        return gzip.compress(_worded(gzip.decompress(raw), word, chance))
    if raw.startswith(b"PK"):
        with zipfile.ZipFile(io.BytesIO(raw)) as packed:
            one = chance.choice(packed.namelist())
        return repacked(raw, lambda n, data: _worded(data, word, chance) if n == one else data)
    for _ in range(chance.choice((1, 2, 8))):
        spans = [m.span() for m in WORD.finditer(raw[:200_000])] or [(0, 0)]
        at, to = chance.choice(spans)
        raw = raw[:at] + word + raw[to:]
    return raw


@dataclass(frozen=True)
class Judged:
    """A trial, and which of `COLUMNS` it was."""

    tried: Tried
    wrong: tuple[str, ...]


def tried(one: Format, k: int, seed: int, sample: Path, forked: Forked) -> Judged:
    """What became of a command that read the file."""
    chance = Random(f"{seed} {one.name} {k}")  # noqa: S311 - a benchmark
    folder, outside = forked.folder(sample), forked.work / "outside"
    outside.mkdir(exist_ok=True)
    (outside / "secret").write_text(f'{{"{SECRET}": 1}}\n')
    before = _content(outside)
    marks = _marks(forked.work)
    how = hostile(one, k, chance, folder, outside)
    kept: list[str] = []
    line = list(one.commands[k // 2 % len(one.commands)])
    t = forked.run(line, folder, how, one.stdin, look=lambda: kept.extend(_judged(folder)))
    wrong = {x: x in kept for x in ("executed", "read outside")}
    wrong["executed"] |= _marks(forked.work) != marks
    wrong["written outside"] = _content(outside) != before
    named = how.endswith(LINK) and one.files[k % len(one.files)] in line
    wrong["read outside"] = not named and (wrong["read outside"] or SECRET in t.said)
    wrong["over 2 GiB"] = "MemoryError" in t.said or t.exit == -9
    wrong["over 60 s"] = t.exit is None
    wrong["defects"] = bool(t.wrong) and t.exit is not None
    return Judged(t, tuple(x for x in COLUMNS if wrong[x]))


def _content(folder: Path) -> dict[str, bytes]:
    return {p.name: p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def _marks(work: Path) -> int:
    return sum(1 for place in (work, Path.cwd(), Path.home()) if (place / RAN).exists())


def _judged(folder: Path) -> list[str]:
    """What a command left in its folder that it may not."""
    found = ["executed"] if list(folder.rglob(RAN)) else []
    for path in folder.rglob("*"):
        if path.is_symlink() or not path.is_file() or path.stat().st_size > 2**26:
            continue
        if SECRET.encode() in path.read_bytes():
            found.append("read outside")
    return found


def heading() -> str:
    """The names of the columns."""
    return f"{'':14} {'files':>6} " + " ".join(f"{c:>15}" for c in COLUMNS) + f" {'longest':>9}"


def row(name: str, judged: list[Judged]) -> str:
    """What became of a format."""
    counts = Counter(w for j in judged for w in j.wrong)
    longest = max(j.tried.took_s for j in judged)
    cells = " ".join(f"{counts[c]:15}" for c in COLUMNS)
    return f"{name:14} {len(judged):6} {cells} {longest:8.1f}s"


def told(rows: dict[str, list[Judged]]) -> int:
    """Print the first of each kind of what was wrong; how many were."""
    first: dict[str, Judged] = {}
    for name, judged in rows.items():
        for j in judged:
            for w in j.wrong:
                first.setdefault(f"{name}: {w}", j)
    for what, j in first.items():
        words = " ".join(j.tried.words)
        print(f"\n{what}\n  {j.tried.what[:200]}\n  soter {words[:200]}\n  {j.tried.wrong}")
    wrong = sum(bool(j.wrong) for judged in rows.values() for j in judged)
    print(f"\n{sum(len(j) for j in rows.values())} files: {wrong} wrong; target 0")
    return wrong


def main() -> int:
    """Try all of them; 0 where nothing was wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="formats, with commas")
    parser.add_argument("--each", type=int, help="so many of a format, spread over all of its own")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    known = {**formats(), **{f.name: f for f in MORE}}
    names = given.only.split(",") if given.only else [n for n in known if n not in ("python", "c")]
    bad_input_commands.LIMIT_S = LIMIT_S
    bad_input_commands.CALLS.update(CALLS)
    rows: dict[str, list[Judged]] = {}
    with tempfile.TemporaryDirectory(prefix="hostile_files_") as work:
        os.environ["SOTER_CACHE"] = str(Path(work) / "cache")
        sample = Path(work) / "sample"
        samples(sample, names)
        if set(names) - set(formats()):
            more_samples(sample)
        print(heading())
        for name in names:
            forked = Forked(Path(work) / name)
            for words in known[name].commands:
                begin = forked.warm if known[name].sealed is None else forked.accepted
                begin([*words], sample, known[name].stdin)
            forked.memory = bad_input_commands.mapped() + MEMORY
            one, seed = known[name], given.seed
            judged = [tried(one, k, seed, sample, forked) for k in chosen(one, given.each)]
            rows[name] = judged
            print(row(name, judged), flush=True)
    return 1 if told(rows) else 0


if __name__ == "__main__":
    sys.exit(main())
