"""What a mapping and a foreign log may get wrong: each is told with its code and its place."""

from __future__ import annotations

import copy
import json
from typing import TYPE_CHECKING, Any

import pytest

from soter.api import load
from soter.diagnostics.diagnostic import SoterError
from soter.mapping.read_mapping import make_log_map
from soter.monitor.log_files.read_columns import read_columns
from soter.monitor.typed_samples import read_samples

if TYPE_CHECKING:
    from pathlib import Path

PROGRAM = """soter 1;
type Gear = enum { LOW, HIGH };
type Seen = { x: float, v: float };
topic seen: Seen max_age 200ms;
topic gear: Gear;
topic on: bool;
topic count: int in [0, 9];
topic heard: float[<=3];
topic push: float in [-1.0, 1.0];
plant P period 10ms {
  drives seen = { x: x, v: x };
  drives gear = Gear.LOW;
  drives on = true;
  drives count = 0;
  drives heard = [];
  state x: float;
}
node A period 10ms { publishes push; step { publish push = 0.0; } }
node B period 10ms { publishes push; step { publish push = 0.0; } }
rta M {
  ac A;
  sc B;
  period 100ms;
  safe seen.x < 9.0;
  ttf seen.x > 5.0;
  safer seen.x < 4.0 && gear == Gear.LOW && on && count < 5;
}
system S { p: P; module M; }
"""
FIELDS = {
    "seen": {"fields": {"x": "x", "v": "v"}},
    "gear": {"fields": {"value": "gear"}},
    "on": {"fields": {"value": {"constant": True}}},
    "count": {"fields": {"value": "count"}},
}
MAP: dict[str, Any] = {"time": {"from": "t"}, "topics": FIELDS}
LOG = "t,x,v,gear,count\n0.0,1.0,0.5,LOW,1\n0.1,1.1,0.5,LOW,1\n0.2,1.2,0.5,HIGH,2\n"


@pytest.fixture
def program(tmp_path: Path) -> Any:
    path = tmp_path / "p.soter"
    path.write_text(PROGRAM)
    loaded_program = load(path)
    assert loaded_program.ok, loaded_program.diagnostics
    return loaded_program


def judge(program: Any, tmp_path: Path, mapping: Any, text: str = LOG, **how: Any) -> Any:
    log = tmp_path / "log.csv"
    log.write_text(text)
    return program.judge_log(log, mapping, **how)


def refused(program: Any, tmp_path: Path, mapping: Any, text: str = LOG, **how: Any) -> list[Any]:
    with pytest.raises(SoterError) as error:
        judge(program, tmp_path, mapping, text, **how)
    return [(d.code, d.message) for d in error.value.diagnostics]


def changed(*path: str, to: object) -> Any:
    """The mapping with another value at a place; None takes it away."""
    mapping = copy.deepcopy(MAP)
    place = mapping
    for name in path[:-1]:
        place = place.setdefault(name, {})
    if to is None:
        del place[path[-1]]
    else:
        place[path[-1]] = to
    return mapping


def test_a_log_that_fits_is_judged(program: Any, tmp_path: Path) -> None:
    (module,) = judge(program, tmp_path, MAP).modules
    assert (module.steps, module.ac) == (3, 3)
    assert [c.to for c in module.changes] == ["AC"]


WRONG_MAPPINGS = [
    (("topics", "sen"), {}, "the system has no topic `sen`: did you mean `seen`?"),
    (("topics", "seen", "fields", "vel"), "v", "`seen` has no `vel`"),
    (("topics", "seen", "fields", "v"), None, "given whole, or not at all: `v` missing"),
    (("topics", "seen", "fields", "v"), 3, "neither the name of a column nor a table"),
    (("topics", "seen", "fields", "v"), {"from": "v", "unit": "parsec"}, "is in `parsec`"),
    (("topics", "seen", "fields", "v"), {"from": "v", "unit": {}}, "is in `{}`"),
    (("topics", "seen", "fields", "v"), {"from": "v", "scale": 0}, "`scale` of `seen.v` is 0"),
    (("topics", "seen", "fields", "v"), {"from": "v", "offset": "a"}, "no finite number"),
    (("topics", "seen", "fields", "v"), {"from": 3}, "`from` of `seen.v` is no name"),
    (("topics", "seen", "fields", "v"), {"from": "v", "constant": 1}, "needs one of"),
    (("topics", "seen", "fields", "v"), {"constant": "fast"}, "expected a number"),
    (("topics", "seen", "fields", "v"), {"constant": float("inf")}, "not finite"),
    (("topics", "seen", "fields", "v"), {"slope": "x"}, "needs a `window`"),
    (("topics", "seen", "fields", "v"), {"slope": "y", "window": "1s"}, "no field of it"),
    (("topics", "seen", "fields", "v"), {"slope": "v", "window": "1s"}, "which no column gives"),
    (("topics", "seen", "fields", "v"), {"slope": "x", "window": "1"}, "a number with its unit"),
    (("topics", "seen", "fields", "v"), {"slope": "x", "window": "0s"}, "no time above 0"),
    (("topics", "gear", "fields", "value"), {"from": "gear", "scale": 2}, "takes no scale"),
    (("topics", "gear", "fields", "value"), {"constant": "THIRD"}, "expected one of"),
    (("topics", "heard"), {"fields": {}}, "which no mapping can fill"),
    (("topics", "seen", "between"), "cubic", "hold or linear"),
    (("topics", "seen", "channel"), 3, "`channel` of `seen` is no name"),
    (("topics", "seen", "colour"), 3, "says `colour`"),
    (("topics", "seen"), "x", "`seen` is no table"),
    (("time", "unit"), "hours", "`time` is in `hours`"),
    (("time", "unit"), ["s"], "`time` is in"),
    (("time", "scale"), -1, "no number from 1e-12"),
    (("time", "scale"), 1e300, "no number from 1e-12"),
    (("time", "scale"), 10**400, "no number from 1e-12"),
    (("time", "from"), 3, "`from` of `time` is no name"),
    (("system",), 3, "`system` is no name"),
    (("tiem",), {}, "says `tiem`"),
    (("topics",), {}, "names no topics"),
    (("topics",), [], "is no table"),
]


@pytest.mark.parametrize(("path", "to", "text"), WRONG_MAPPINGS)
def test_a_mapping_that_does_not_fit_is_refused_in_words(
    program: Any, tmp_path: Path, path: tuple[str, ...], to: object, text: str
) -> None:
    problems = refused(program, tmp_path, changed(*path, to=to))
    assert {code for code, _ in problems} == {"D015"}
    assert any(text in message for _, message in problems), problems


def test_every_mistake_of_a_mapping_is_told_at_once(program: Any, tmp_path: Path) -> None:
    wrong = changed("topics", "seen", "fields", "vel", to="v")
    wrong["time"]["unit"] = "hours"
    assert len(refused(program, tmp_path, wrong)) == 2


WRONG_LOGS = [
    ("", "it is empty"),
    ("t,x,v,gear,count\n", "it has no rows"),
    (LOG.replace("x,", "ex,"), "it has no column `x`"),
    (LOG.replace("t,x,v", "t,x,x"), "two columns are called `x`"),
    (LOG.replace("0.1,1.1", "0.3,1.1"), "time goes back in line 4, from 0.3 s to 0.2 s"),
    (LOG.replace("0.1,", "0.0,").replace("0.2,", "0,"), "all that counts is of 0 s"),
    (LOG.replace("0.1,1.1", "soon,1.1"), "`soon` in line 3 is no time"),
    (LOG.replace("0.1,1.1", "nan,1.1"), "`nan` in line 3 is no time"),
    (LOG.replace("0.1,1.1", "1e99,1.1"), "`1e99` in line 3 is no time"),
    (LOG.replace("1.1", "one"), "`one` in line 3, `x`, is no `float`"),
    (LOG.replace("HIGH", "THIRD"), "`THIRD` in line 4, `gear`, is no"),
    (LOG.replace("HIGH,2", "HIGH,2.5"), "`2.5` in line 4, `count`, is no"),
    (LOG.replace("HIGH,2", "HIGH,12"), "`12` in line 4, `count`, is no"),
    (LOG.replace("0.5,HIGH", "0.5,0.5,HIGH"), "line 4 has 6 cells, the head 5"),
    (LOG + "9000000000.0,1.2,0.5,HIGH,2\n", "it spans 9,000,000,000 s, 90,000,000,000 decisions"),
    ("t,x,v,gear,count\n0.0,,0.5,LOW,1\n", "no row of it has all of `seen`"),
    ("t,x,v,gear,count\n0.0,\xff", "line 2 has 2 cells"),
    (LOG.replace("HIGH,2", 'HIGH,"2'), "the row of line 4: unexpected end of data"),
    (LOG.replace("0.0,1.0", '"0.0,1.0'), "the row of line 2: unexpected end of data"),
    (LOG.replace("LOW,1", 'LOW,"1'), "the row of line 2: ',' expected"),
    (LOG.replace("LOW,1\n0", 'LOW,"1\n"0'), "the row of line 2: ',' expected"),
    (LOG.replace("LOW,1\n0.1", '"LOW\n",1\n0.1'), "the row of line 2 goes on to line 3"),
    (LOG.replace("gear,", '"gear\n",'), "the row of line 1 goes on to line 2"),
    (LOG.replace("1,1.1", '1,"1.1').replace("LOW,1\n0.2", 'LOW,1\n"'), "the row of line 3 goes on"),
    (LOG.replace("1.1", "0_1"), "`0_1` in line 3, `x`, is no `float`"),
    (LOG.replace("0.1,1.1", "0_1,1.1"), "`0_1` in line 3 is no time"),
    (LOG.replace("HIGH,2", "HIGH,0_2"), "`0_2` in line 4, `count`, is no"),
    (LOG.replace("1.1", "\u0661.1"), "in line 3, `x`, is no `float`"),
]


@pytest.mark.parametrize(("text", "told"), WRONG_LOGS)
def test_a_log_that_does_not_fit_is_refused_with_its_line(
    program: Any, tmp_path: Path, text: str, told: str
) -> None:
    ((code, message),) = refused(program, tmp_path, MAP, text)
    assert code == "D016"
    assert told in message


def test_rows_are_chosen_and_a_choice_of_none_is_told(program: Any, tmp_path: Path) -> None:
    head, *rows = LOG.splitlines()
    both = [head + ",flight", *(r + ",1" for r in rows), *(r + ",2" for r in rows)]
    text = "\n".join(both) + "\n"
    ((code, message),) = refused(program, tmp_path, MAP, text)
    assert (code, "time goes back in line 5" in message) == ("D016", True)
    assert judge(program, tmp_path, MAP, text, where={"flight": "2"}).samples["seen"] == 3
    ((code, message),) = refused(program, tmp_path, MAP, text, where={"flight": "3"})
    assert (code, "no row has flight = 3" in message) == ("D016", True)


def test_files_that_cannot_be_read_are_told(program: Any, tmp_path: Path) -> None:
    missing = tmp_path / "nowhere.csv"
    mapping = tmp_path / "map.json"
    mapping.write_text(json.dumps(MAP))
    broken = tmp_path / "broken.toml"
    broken.write_text("[topics\n")
    deep = tmp_path / "deep.json"
    deep.write_text("[" * 100_000)
    junk = tmp_path / "junk.mcap"
    junk.write_bytes(b"no mcap at all")
    zipped = tmp_path / "junk.csv.gz"
    zipped.write_bytes(b"no gzip at all")
    channels = copy.deepcopy(MAP)
    for topic in channels["topics"].values():
        topic["channel"] = "c"
    cases = [
        (missing, mapping, "D016"),
        (missing, tmp_path / "none.json", "D015"),
        (missing, broken, "D015"),
        (missing, deep, "D015"),
        (junk, channels, "D016"),
        (junk, MAP, "D016"),
        (zipped, MAP, "D016"),
    ]
    for log, given, code in cases:
        with pytest.raises(SoterError) as error:
            program.judge_log(log, given)
        assert {d.code for d in error.value.diagnostics} == {code}, log


@pytest.mark.parametrize(
    ("row", "assumed"),
    [
        ("x", "m"),
        ({"from": "x", "offset": 1.0}, "m"),
        ({"from": "x", "unit": "mm"}, ""),
        ({"from": "x", "scale": 0.001}, ""),
        ({"constant": 1.0}, ""),
    ],
)
def test_a_column_whose_unit_nobody_says_is_taken_in_the_programs_and_that_is_said(
    tmp_path: Path, row: Any, assumed: str
) -> None:
    """Millimetres that are read as metres are a violation of nothing, or hide one."""
    path = tmp_path / "p.soter"
    path.write_text(PROGRAM.replace("x: float, v", 'x: float unit "m", v', 1))
    topics = {**FIELDS, "seen": {"fields": {"x": row, "v": "v"}}}
    judged = judge(load(path), tmp_path, {**MAP, "topics": topics})
    said = [a for a in judged.assumptions if "says a unit" in a]
    assert [a.rsplit(": ", 1)[1] for a in said] == ([f"`seen.x` in `{assumed}`"] if assumed else [])


@pytest.mark.parametrize("mark", [";", "\t", "|"])
def test_a_table_of_another_separator_is_told_that_commas_part_cells(
    program: Any, tmp_path: Path, mark: str
) -> None:
    with pytest.raises(SoterError, match="it has no column") as error:
        judge(program, tmp_path, MAP, LOG.replace(",", mark))
    told = error.value.diagnostics[0].helps
    assert f"cells are parted by commas, not by {mark!r}" in told[0]


def test_a_mapping_of_constants_alone_asks_nothing_of_a_log(program: Any, tmp_path: Path) -> None:
    given = {"topics": {"on": {"fields": {"value": {"constant": True}}}}}
    problems = refused(program, tmp_path, given)
    assert problems[0][0] == "D017"


def test_options_that_do_not_go_together_are_refused(program: Any, capsys: Any) -> None:
    from soter.cli.main import main

    for arguments, told in [
        (["--where", "a=1"], "`--where` does nothing without `--map`"),
        (["--map", "m.toml"], "`--map` does nothing without `LOG`"),
        (["log.csv", "--map", "m.toml", "--where", "a"], "COLUMN=TEXT"),
        (["log.csv", "--map", "m.toml", "--until", "1s"], "`--until` does nothing beside `LOG`"),
        (["log.csv", "--map", "m.toml", "--emit", "x"], "`LOG` does nothing beside `--emit`"),
    ]:
        assert main(["monitor", program.path, *arguments]) == 2
        assert told in capsys.readouterr().err


@pytest.mark.parametrize(("delayed", "delay_ns"), [("", 0), ("every 1s delayed 5ms", 5_000_000)])
def test_a_row_without_a_stamp_was_measured_the_declared_delay_before_it_was_logged(
    tmp_path: Path, delayed: str, delay_ns: int
) -> None:
    """As a bridge counts: the same file is as old through every door."""
    outside = f"external topic seen {delayed}; external topic push;"
    outside += "external topic gear; external topic on; external topic count;"
    path, log = tmp_path / "p.soter", tmp_path / "log.csv"
    path.write_text(f"{PROGRAM}system V {{ {outside} module M; }}")
    log.write_text(LOG)
    mapped = make_log_map({**MAP, "system": "V"}, load(path).flat("V"))
    seen, *_ = read_samples(log, mapped, read_columns(log, mapped))
    assert seen.times_ns == [0, 100_000_000, 200_000_000]
    assert seen.stamps_ns == [t - delay_ns for t in seen.times_ns]
