"""Random programs: the reference interpreter and the generated C give the same bytes.

Each program is checked, run for 500 instants by the interpreter and by its C at -O0 and -O2,
compiled with every warning an error, and every state after every instant is compared: topics,
locals, modes, OE, latches, counters, random draws.

    make test                                   40 programs, always the same
    SOTER_TEST_SCALE=25 make test               1000, these among them
    make soak N=600                             fresh ones, ten minutes long
    SOTER_TEST_SEED=4711 SOTER_TEST_SCALE=0 pytest tests/correct/test_engines_agree.py   one

A failure prints the program, made smaller, and the first differing instant and member.
"""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import pytest

from generators import outside_input_driver
from generators.engine_comparison import (
    CompileError,
    compile_library,
    first_difference,
    interpreted_trace,
    native_trace,
    subject,
)
from generators.program_reducer import reduced
from generators.random_programs import program
from generators.run_statistics import happened, table
from long_tests import examples, seeds
from soter.diagnostics.diagnostic import Diagnostics, Source
from soter.language.evaluate.arithmetic import FaultKind
from soter.language.model.system import environment_topics
from soter.language.syntax.printer import format_source

if TYPE_CHECKING:
    from generators.engine_comparison import Subject

INSTANTS = 500
BATCH = 15
LEVELS = ("-O0", "-O2")
REFUSALS = (FaultKind.NONFINITE, FaultKind.RANGE, FaultKind.EXTERN)
PROGRAMS = examples(40)
CHUNKS = min(20, max(3, PROGRAMS // BATCH))


def first_of_four(quick: int) -> list[object]:
    """Numbers of four chunks, of which all but the first few take long together."""
    return [pytest.param(i, marks=[] if i < quick else [pytest.mark.long]) for i in range(4)]


def make(number: int, text: str | None = None) -> Subject:
    """Program `number` with a seed of its own."""
    key = number * 0x9E3779B97F4A7C15 % 2**64
    return subject(f"p{number}", text or program(number), key, INSTANTS)


def complaint(subjects: list[Subject]) -> tuple[Subject, str] | None:
    """The first of some programs on which the engines differ, and how; None when there is none."""
    with TemporaryDirectory(prefix="soter-equality-") as name:
        libraries = [compile_library(subjects, Path(name), level) for level in LEVELS]
        for s in subjects:
            interpreted = interpreted_trace(s)
            for level, library in zip(LEVELS, libraries, strict=True):
                different = first_difference(s, native_trace(library, s), interpreted)
                if different is not None:
                    return s, f"{level}: {different}"
    return None


def complaint_of_any(subjects: list[Subject]) -> tuple[Subject, str] | None:
    """The same, with a compiler's complaint put down to the program that it is about."""
    try:
        return complaint(subjects)
    except CompileError:
        for s in subjects:
            try:
                failure = complaint([s])
            except CompileError as error:
                return s, str(error)
            if failure is not None:
                return failure
        raise


def kind_of(words: str) -> str:
    """What must stay the same while a program is made smaller."""
    members = re.findall(r"^  (\w+)", words, re.MULTILINE)
    return "compiler" if "error:" in words else members[0] if members else "length"


def report(number: int, s: Subject, words: str) -> str:
    """The text of a failure."""

    def fails(text: str) -> bool:
        try:
            failure = complaint_of_any([make(number, text)])
        except Exception:  # noqa: BLE001 - it does not check, or fails in another way
            return False
        return failure is not None and kind_of(failure[1]) == kind_of(words)

    text = reduced(s.text, fails)
    smaller = complaint_of_any([make(number, text)])
    return (
        f"the engines differ on program {number}\n{words}\n\nmade smaller:\n\n{text}\n"
        f"{smaller[1] if smaller else ''}\nagain: SOTER_TEST_SEED={number} SOTER_TEST_SCALE=0"
    )


@pytest.mark.parametrize("chunk", range(CHUNKS))
@pytest.mark.random
def test_engines_agree_on_every_byte(chunk: int) -> None:
    todo = seeds(chunk, PROGRAMS, CHUNKS)
    for start in range(0, len(todo), BATCH):
        batch = {n: make(n) for n in todo[start : start + BATCH]}
        failure = complaint_of_any(list(batch.values()))
        if failure is not None:
            number = next(n for n, s in batch.items() if s is failure[0])
            pytest.fail(report(number, *failure), pytrace=False)


@pytest.mark.parametrize("chunk", first_of_four(1))
@pytest.mark.long
def test_engines_agree_where_every_struct_is_large(
    chunk: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("soter.codegen.c_types.LARGE", 0)
    batch = {n: make(n) for n in range(40_000 + chunk, 40_000 + 4 * BATCH, 4)}
    failure = complaint_of_any(list(batch.values()))
    if failure is not None:
        pytest.fail(report(next(n for n, s in batch.items() if s is failure[0]), *failure))


@pytest.mark.parametrize("chunk", first_of_four(2))
def test_engines_agree_on_inputs_from_outside(chunk: int, tmp_path: Path) -> None:
    made = [make(number) for number in range(30_000 + chunk, 30_060, 4)]
    subjects = [s for s in made if environment_topics(s.system)]
    library = compile_library(subjects, tmp_path, "-O2" if chunk % 2 else "-O0")
    kinds: list[int] = []
    for s in subjects:
        words = outside_input_driver.first_disagreement(s, library, 100, kinds)
        assert words is None, f"{words}\n\n{s.text}"
    seen = Counter(kinds)
    assert min(seen[k] for k in (0, *map(int, REFUSALS))) > 20, seen


def without_places(source: str) -> str:
    """Generated C without the hash and the line numbers of the program."""
    return re.sub(r"[\w.]+\.soter:\d+|\b[0-9a-f]{64}\b", "", source)


@pytest.mark.parametrize("chunk", first_of_four(1))
@pytest.mark.long
def test_the_printer_keeps_the_meaning(chunk: int) -> None:
    for number in range(10_000 + chunk, 10_040, 4):
        s = make(number)
        diagnostics = Diagnostics()
        printed = format_source(Source(f"{s.name}.soter", s.text), diagnostics)
        assert printed is not None, diagnostics.items
        again = make(number, printed).unit
        assert without_places(again.source) == without_places(s.unit.source)


LEAST_SHARES = {
    "any fault": 0.5,
    "any latched": 0.2,
    "burst": 0.12,
    "burst into a queue": 0.03,
    "choice": 0.3,
    "choice of a plant": 0.1,
    "clean steps owed": 0.3,
    "contract violated": 0.1,
    "fair choice": 0.1,
    "fault overflow": 0.05,
    "fault index": 0.05,
    "fault divide": 0.05,
    "fault convert": 0.03,
    "fault assert": 0.03,
    "fault capacity": 0.03,
    "fault nonfinite": 0.05,
    "fault range": 0.05,
    "gate fault in control": 0.15,
    "input driven": 0.5,
    "latch": 0.3,
    "latch released": 0.15,
    "latch released twice": 0.05,
    "latched sc": 0.03,
    "module above a module": 0.15,
    "plant": 0.6,
    "property violated": 0.15,
    "queue": 0.2,
    "queue overflow": 0.03,
    "sometimes stale": 0.08,
    "still moving": 0.8,
    "sub-systems": 0.2,
    "release lost": 0.03,
    "returns never": 0.03,
    "starts anew": 0.1,
    "switch to AC": 0.3,
    "switch to SC": 0.3,
    "takes": 0.2,
    "takes in AC": 0.1,
    "NaN compared": 0.1,
    "NaN compared at times": 0.05,
    "ten switches": 0.1,
    "two modules": 0.2,
}


@pytest.mark.long
def test_the_programs_are_interesting(tmp_path: Path) -> None:
    """Equality on programs that do nothing would show nothing."""
    count = 60
    subjects = [make(20_000 + n) for n in range(count)]
    counts: Counter[str] = Counter()
    library = compile_library(subjects, tmp_path, "-O0")
    for s in subjects:
        counts.update(happened(s, native_trace(library, s)))
    print(table(counts, count))
    too_rare = {
        what: counts[what] for what, least in LEAST_SHARES.items() if counts[what] < least * count
    }
    assert not too_rare, table(counts, count)
