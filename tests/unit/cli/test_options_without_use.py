"""No option does nothing in silence: each acts always, or is refused without what it needs.

`ALWAYS` and `NEEDS` of a command's record share its options out. One that is added and stands in
neither fails the first test.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import pytest

import soter as api
from soter.cli.main import COMMANDS, command_module
from soter.cli.new import Options as NewOptions
from soter.diagnostics.command_records import Option, make_record, option, options_of
from soter.diagnostics.diagnostic import SoterError
from soter.explore.search_options import SearchOptions
from soter.simulate.run_options import RunOptions

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    Soter = Callable[..., Any]

ALWAYS = {
    "check": "files params times format",
    "show": "file system params core",
    "run": "file system params log report why recorded trace sha256 progress partial apart",
    "verify": "file module system params cert report synthesize no_refute budget write format",
    "recheck": "folder logs report",
    "monitor": "file system module emit params format",
    "advise": "file module system params delay",
    "campaign": "file system hours flights until seed workers arms saves report parquet params "
    "output",
    "test": "file test strategy memory time max_states seed minimise all_properties skew horizon "
    "params output junit progress partial format",
    "assure": "file system cert tests test_report campaign hazards params output",
    "replay": "trace html mcap",
    "policy": "file statistics within output",
    "diff": "old new hazards report",
    "identify": "logs file open episode output map system module report params",
    "measure": "file system margin params output",
    "build": "file target output system cert board map params",
    "explain": "code",
    "fmt": "files check diff",
    "lsp": "stdio tcp",
    "new": "name robot logs",
    "completion": "shell",
    "cache": "action size",
}
"""Options that act whatever else is said, or that the command itself refuses (`build --board`)."""
RECORDS = {name: command_module(name).Options for name in COMMANDS if name != "help"}
"""The record of options of each command."""


def needs_of(record: type) -> list[tuple[str, str]]:
    """Each option that does nothing without something else, with the condition."""
    rows = getattr(record, "NEEDS", ())
    return [(name, need) for need, names in rows for name in names.split()]


def unsaid(record: type, always: str) -> tuple[set[str], set[str]]:
    """The options of which nothing is said, and those of which both or something else is said."""
    needing = {name for name, _ in needs_of(record)}
    known, told = set(options_of(record)), set(always.split())
    return known - needing - told, (needing & told) | ((needing | told) - known)


@pytest.mark.parametrize("name", RECORDS)
def test_each_option_acts_always_or_says_what_it_needs(name: str) -> None:
    assert unsaid(RECORDS[name], ALWAYS[name]) == (set(), set())


def test_an_option_that_is_added_without_a_word_is_found() -> None:
    @dataclass(frozen=True, kw_only=True)
    class Added(NewOptions):
        quick: bool = option("--quick", False, "a new one")

    assert unsaid(Added, ALWAYS["new"]) == ({"quick"}, set())
    assert unsaid(Added, ALWAYS["new"] + " quick partial") == (set(), {"partial"})


# ---------------------------------------------------------------- a line without what is needed


def word(known: Option, value: str | None = None) -> list[str]:
    """An option as it stands on a line, with a value that is not its default, or with this one."""
    *flags, last = known.flags.split()
    if last.startswith("--"):
        return [last]
    if value is None:
        others = [n for n in known.kind.names if n != known.default]
        text = known.kind.text if isinstance(known.kind.text, str) else ""
        of_kind = {"whole": "2", "bound": "2", "seed": "2", "seconds": "2s"}
        value = others[0] if others else of_kind.get(text, "2")
    return [*flags[:1], value] if value else flags[:1]


def violating(one: str, options: dict[str, Option]) -> list[str]:
    """Words of a line on which a condition does not hold."""
    name, equals, values = one.lstrip("!").partition("=")
    if one.startswith("!"):
        return word(options[name], values if equals else None)
    others = [n for n in options[name].kind.names if n not in values.split(",")]
    return word(options[name], others[0]) if equals and others else []


def fulfilling(need: str, options: dict[str, Option]) -> list[str]:
    """Words of a line on which a condition holds."""
    name, equals, values = need.split("|", maxsplit=1)[0].partition("=")
    if need.startswith("!"):
        return []
    return word(options[name], values.split(",")[0] if equals else None)


def required(record: type) -> list[str]:
    """The words without which the command has no line."""
    options = options_of(record).values()
    needed = [o for o in options if o.default is ... or o.flags == "LOG..."]
    return [w for o in needed for w in word(o, "no/such")]


ROWS = [
    (name, option, need)
    for name, record in RECORDS.items()
    for option, need in needs_of(record)
    if not need.endswith("=None")  # of Python alone
]


def told(soter: Soter, name: str, words: list[str]) -> set[str]:
    """The options that a command line says do nothing."""
    done = soter(name, *required(RECORDS[name]), *words, "--json")
    assert done.exit in (1, 2), words
    said = [d for d in done.document["diagnostics"] if "does nothing" in d["message"]]
    assert {d["code"] for d in said} <= {"U001"}
    assert done.exit == 2 or not said
    return {m[1] for d in said if (m := re.match(r"`(.+?)` does nothing", d["message"]))}


@pytest.mark.parametrize(("name", "field", "need"), ROWS, ids=lambda x: x)
def test_an_option_without_what_it_needs_is_refused_before_anything_is_read(
    soter: Soter, name: str, field: str, need: str
) -> None:
    options = options_of(RECORDS[name])
    without = [w for one in need.split("|") for w in violating(one, options)]
    all_needs = [n for o, n in needs_of(RECORDS[name]) if o == field]
    fulfilled = [w for n in all_needs for w in fulfilling(n, options)]
    for rest, refused in ((without, True), (fulfilled, False)):
        words = [*word(options[field]), *rest]
        if options[field].dashed:  # what has no flag comes first, as people write it
            words = [*rest, *word(options[field])]
        assert (options[field].flag in told(soter, name, words)) == refused


@pytest.mark.parametrize(
    ("line", "flag"),
    [
        ("test absent --strategy random --reduction all", "--reduction"),
        ("test absent --runs 10000", "--runs"),
        ("monitor absent log.mcap --seed 1", "--seed"),
        ("run absent --misses 0", "--misses"),
        ("assure absent -o out --flights 20", "--flights"),
        ("run absent --real-time --engine interp --misses 0", "--misses"),
    ],
)
def test_a_default_that_is_written_counts_as_given(soter: Soter, line: str, flag: str) -> None:
    """On a command line one can tell; in Python a default is as what is left out (see below)."""
    assert f"error[U001]: `{flag}` does nothing " in soter(*line.split()).err


def test_all_that_have_no_use_are_told_at_once(soter: Soter) -> None:
    done = soter("monitor", "absent", "log.mcap", "--emit", "W", "--until", "3s", "--estimates")
    assert done.exit == 2
    assert re.findall(r"`(\S+)` does nothing (.*)", done.err) == [
        ("LOG", "beside `--emit`"),
        ("--until", "beside `--emit`"),
        ("--estimates", "beside `--emit`"),
        ("--until", "beside `LOG`"),
    ]


# ---------------------------------------------------------------- the same of keywords in Python

PYTHON: dict[str, tuple[Any, dict[str, Any]]] = {
    "a recording has its own seed": (RunOptions, {"recorded": "f.rec", "seed": 2}),
    "a recording is over": (RunOptions, {"recorded": "f.rec", "until": 3.0}),
    "a folder of no arm": (RunOptions, {"campaign": "folder"}),
    "a folder of an arm that needs none": (RunOptions, {"campaign": "folder", "arm": "ac"}),
    "runs of all executions": (SearchOptions, {"runs": 5}),
    "threads of samples": (SearchOptions, {"strategy": "falsify", "threads": 2}),
    "storage of samples": (SearchOptions, {"strategy": "random", "storage": "fingerprint"}),
    "pages in no folder": (SearchOptions, {"html": True, "output": None}),
}


@pytest.mark.parametrize("case", PYTHON)
def test_a_keyword_without_use_is_refused_by_its_name(case: str, tmp_path: Path) -> None:
    record, given = PYTHON[case]
    (tmp_path / "p.soter").write_text("soter 1;\n", encoding="utf-8")
    program = api.load(tmp_path / "p.soter")
    call: Any = program.simulate if record is RunOptions else program.explore
    with pytest.raises(SoterError) as caught:
        call(**given)
    (problem,) = caught.value.diagnostics
    assert (problem.code, problem.message.split(" does nothing ")[0].strip("`") in given) == (
        "U001",
        True,
    )


@pytest.mark.parametrize(
    ("name", "given", "said"),
    [
        ("monitor", {"log": "f.mcap", "seed": 3}, "`seed` does nothing beside `log`"),
        ("monitor", {"log": "f.mcap", "until": 3.0}, "`until` does nothing beside `log`"),
        ("assure", {"output": "out", "flights": 5}, "`flights` does nothing without `campaign`"),
    ],
)
def test_a_keyword_of_a_method_without_a_record_is_refused_likewise(
    here: Path, name: str, given: dict[str, Any], said: str
) -> None:
    with pytest.raises(SoterError, match=said) as caught:
        getattr(api.load(here / "cart.soter"), name)(**given)
    assert [d.code for d in caught.value.diagnostics] == ["U001"]


@pytest.mark.parametrize("record", [RunOptions, SearchOptions])
def test_a_keyword_with_its_default_is_as_one_that_is_left_out(record: Any) -> None:
    """A function of somebody's own may hand on all of them."""
    defaults = {n: o.default for n, o in options_of(record, keyword=True).items()}
    assert make_record(record, defaults) == make_record(record, {})
    if record is SearchOptions:
        assert make_record(record, {**defaults, "strategy": "random"}).strategy == "random"


def names(conditions: Iterator[str]) -> set[str]:
    return {one.lstrip("!").partition("=")[0] for need in conditions for one in need.split("|")}


@pytest.mark.parametrize("name", RECORDS)
def test_conditions_are_about_options_that_there_are(name: str) -> None:
    conditions = names(need for _, need in needs_of(RECORDS[name]))
    assert conditions <= set(options_of(RECORDS[name]))


# ---------------------------------------------------------------- what only the program decides


@pytest.mark.parametrize(
    ("line", "code", "said"),
    [
        ("verify cart.soter --synthesize", "U001", "`--synthesize` does nothing"),
        ("assure cart.soter --tests -o out", "U010", "has no `test`"),
        ("show cart.soter --bind Nobody=python:cart.soter:step", "U005", "Nobody"),
        ("monitor cart.soter --emit W.soter --alarm nosuch", "N001", "declares no `nosuch`"),
        (
            "monitor cart.soter --emit W.soter --alarm goal",
            "T001",
            "expected `float`, found `bool`",
        ),
        ("policy absent.zip -o x.c", "U001", "--node PROGRAM:NAME"),
        ("policy absent.zip --node p.soter:Pilot -o x.soter", "U001", "--node PROGRAM:NAME"),
    ],
)
def test_what_cannot_be_done_is_said_and_nothing_is_written(
    soter: Soter, here: Path, line: str, code: str, said: str
) -> None:
    before = sorted(here.iterdir())
    done = soter(*line.split())
    assert done.exit == (2 if code.startswith("U") else 1)
    assert (f"error[{code}]" in done.err, said in done.err) == (True, True)
    assert sorted(here.iterdir()) == before
