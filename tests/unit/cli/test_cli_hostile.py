"""Files and words that no careful person gives a command, and what they get."""

from __future__ import annotations

import json
import os
import re
import shutil
from typing import TYPE_CHECKING

import pytest

from generators.autopilot_logs import dataflash_text, flight, ulog
from soter import load
from soter.cli.main import COMMANDS as ALL
from soter.cli.main import main
from soter.diagnostics.legible_text import legible
from soter.diagnostics.render import safe

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from typing import Any

    Soter = Callable[..., Any]

COMMANDS = [("check",), ("run",), ("build", "-o", "out"), ("fmt",)]
CODE = re.compile(r"error\[[A-Z]\d{3}\]")


@pytest.mark.parametrize("command", COMMANDS, ids=lambda c: c[0])
@pytest.mark.parametrize(
    "name",
    ["missing.soter", "folder", "binary.soter", "huge.soter", "cart.soter/x", "\n", "", "a" * 5000],
    ids=["missing", "folder", "binary", "huge", "below a file", "newline", "empty", "long"],
)
def test_what_cannot_be_read_is_a_diagnostic(
    soter: Soter, here: Path, command: tuple[str, ...], name: str
) -> None:
    (here / "folder").mkdir()
    (here / "binary.soter").write_bytes(bytes(range(256)) * 40)
    with (here / "huge.soter").open("wb") as stream:
        stream.truncate(5 * 1024 * 1024)
    done = soter(*command, name)
    assert done.exit == 1
    assert CODE.match(done.err)
    assert soter(*command, name, "--json").document["diagnostics"]


def test_a_file_without_permission(soter: Soter, here: Path) -> None:
    (here / "cart.soter").chmod(0)
    if os.access(here / "cart.soter", os.R_OK):
        pytest.skip("root may read anything")
    assert soter("check", "cart.soter").exit == 1


def test_control_characters_never_reach_the_terminal(soter: Soter, here: Path) -> None:
    (here / "esc.soter").write_text("soter 1;\nconst \x1b[31mA: int = 3;\n")
    for done in (soter("check", "esc.soter"), soter("check", "\x1b[31mno.soter")):
        assert done.exit == 1
        assert "\x1b" not in done.err


@pytest.mark.parametrize("command", [("check",), ("run", "--until", "20ms")], ids=lambda c: c[0])
@pytest.mark.parametrize("between", ["\n", "\r", "\x1b[2J"], ids=["newline", "return", "escape"])
def test_no_name_of_a_file_is_a_verdict_of_another_one(
    soter: Soter, here: Path, command: tuple[str, ...], between: str
) -> None:
    name = f"a{between}ok  other.soter  1 system.soter"
    shutil.copy(here / "cart.soter", here / name)
    done = soter(command[0], name, *command[1:])
    assert done.exit == 0
    assert "\x1b" not in done.out
    assert not any(line.startswith("ok  other") for line in re.split("[\n\r]", done.out))


@pytest.mark.parametrize(
    "seed", ["-1", "1.5", "", "99999999999999999999", "0x10", "²", "\u0663", "1_0"]
)
def test_seeds_that_are_none(soter: Soter, seed: str) -> None:
    assert soter("run", "cart.soter", "--seed", seed).exit == 2


@pytest.mark.parametrize("option", ["--threads", "--runs", "--max-states", "--minimise"])
@pytest.mark.parametrize("number", ["1_0", "\u0663", "\uff12", "x"])
def test_numbers_are_written_in_plain_digits(soter: Soter, option: str, number: str) -> None:
    done = soter("test", "cart.soter", option, number)
    assert done.exit == 2
    assert f"argument {option}: " in done.err


def test_the_largest_seed(soter: Soter) -> None:
    for engine in ("native", "interp"):
        done = soter(
            "run",
            "cart.soter",
            "--until",
            "10ms",
            "--seed",
            str(2**64 - 1),
            "--engine",
            engine,
            "--json",
        )
        assert done.document["seed"] == 2**64 - 1


@pytest.mark.parametrize(
    "until",
    [
        *("30", "s", "0s", "1e999s", "1 fortnight", "nan s", "0.1ns", "200000h" * 9, "5m"),
        *("1e99999999s", "9" * 400 + "s", "9" * 5000 + "s", "0." + "1" * 5000 + "s"),
    ],
    ids=lambda until: until[:12],
)
def test_lengths_of_time_that_are_none(soter: Soter, until: str) -> None:
    done = soter("run", "cart.soter", "--until", until)
    assert done.exit == 2
    assert "such as 30s" in done.err or "until" in done.err


def test_no_length_of_time_anywhere(soter: Soter, here: Path) -> None:
    text = (here / "cart.soter").read_text().replace("until 30s;", "")
    (here / "endless.soter").write_text(text)
    done = soter("run", "endless.soter")
    assert done.exit == 2
    assert "--until 30s" in done.err


def test_a_program_without_anything_to_run(soter: Soter, here: Path) -> None:
    (here / "empty.soter").write_text("soter 1;\n")
    assert soter("check", "empty.soter").exit == 0
    assert soter("run", "empty.soter").exit == 2


def test_standard_output_that_is_gone(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert here.exists()
    monkeypatch.setattr("sys.stdout", None)
    assert main(["check", "cart.soter"]) == 0
    assert main(["check", "cart.soter", "--json"]) == 0
    monkeypatch.setattr("sys.stderr", None)
    assert main(["check", "nowhere.soter"]) == 1


def test_a_cache_folder_that_cannot_be_written(
    soter: Soter, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (here / "file").write_text("")
    monkeypatch.setenv("SOTER_CACHE", str(here / "file" / "cache"))
    done = soter("run", "cart.soter", "--json")
    assert (done.exit, done.codes) == (1, ["X006"])


@pytest.mark.parametrize("name", ["header", "header_", "topics", "stamps", "main"])
def test_instances_called_like_parts_of_the_state(soter: Soter, here: Path, name: str) -> None:
    text = (here / "cart.soter").read_text()
    text = text.replace("  c: Cart;", f"  {name}: Cart;").replace("c.truth", f"{name}.truth")
    (here / "named.soter").write_text(text)
    runs = {
        soter("run", "named.soter", "--until", "1s", "--engine", e, "--json", "--report").document[
            "trace_sha256"
        ]
        for e in ("native", "interp")
    }
    assert len(runs) == 1


@pytest.mark.parametrize("command", sorted(ALL))
@pytest.mark.parametrize(
    "words", [("caf\udce9.soter",), ("cart.soter", "-o", "o\udce9"), ("a", "--x=\udcff", "--json")]
)
def test_a_name_that_is_not_utf8_is_said_before_any_work(
    soter: Soter, here: Path, command: str, words: tuple[str, ...]
) -> None:
    for name in ("caf\udce9.soter", "a"):
        (here / name).write_text("soter 1;\n")
    before = sorted(here.iterdir())
    done = soter(command, *words)
    assert done.exit == 2
    assert "is not UTF-8" in (done.out if "--json" in words else done.err)
    assert "\\xe9" in done.err or "\\xff" in done.out
    assert sorted(here.iterdir()) == before


def test_a_program_whose_name_is_not_utf8_is_not_read(here: Path) -> None:
    (here / "caf\udce9.soter").write_text("soter 1;\n")
    (problem,) = load(here / "caf\udce9.soter").diagnostics
    assert (problem.code, "caf\\xe9.soter" in problem.message) == ("D005", True)


def test_a_program_in_a_folder_whose_name_is_not_utf8_is_run(soter: Soter, here: Path) -> None:
    folder = here / "d\udce9"
    folder.mkdir()
    shutil.copy(here / "cart.soter", folder)
    os.chdir(folder)
    words = ("--until", "1s", "--report", "--log", "l.mcap", "--json")
    assert soter("run", "cart.soter", *words).exit == 0
    assert soter("monitor", "cart.soter", "l.mcap", "--report").exit == 0


# ---------------------------------------------------------------- texts of strangers
# Names of files, of channels, columns, frames and keys, words of tables and traces are a stranger's
# wherever a log, a mapping, a proof or a program comes from one. JSON escapes them, pages escape
# them by their templates (`tests/unit/report`).

EVIL = (
    "a\x1b[31m\x1b]0;t\x07\x9b31m\r\n::error::pwned\n  ::add-mask::x\n##[error]pwned\u202e\u2028b"
)
"""A name that colours, moves and names a terminal, and speaks to GitHub."""
FILE = EVIL.replace("/", "_")
ACTING = re.compile("[\0-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069\u2028\u2029]")
TAKEN = re.compile(r"(?m)^\s*(:: ?error::pwned|: ?:add-mask|: ?:error|: \[|pwned)|##\[error\]")
OURS = re.compile(r"(?m)^::(error|warning) title=")
WALL = "cart.soter"


def mcap(path: Path, channel: str = EVIL, content: Callable[[int], Any] | None = None) -> None:
    writers = pytest.importorskip("mcap.writer", reason="the extra `logs` is not installed")
    with path.open("wb") as file:
        writer = writers.Writer(file)
        writer.start()
        schema = writer.register_schema(EVIL, "jsonschema", b"{}")
        for name in dict.fromkeys(("/pose", channel)):
            number = writer.register_channel(name, "json", schema)
            for k in range(12):
                said = content(k) if content else {"x": 0.01 * k, "v": 0.0, EVIL: EVIL, "w": k}
                at = 10**9 + 10**7 * k + (0 if name == "/pose" else 10**15)
                writer.add_message(number, at, json.dumps(said).encode(), at)
        writer.finish()


def mapping(**more: Any) -> str:
    topic = {"channel": "/pose", "fields": {"x": "x", "v": "v"}, **more}
    return json.dumps({"system": "Protected", "topics": {"motion": topic}})


def csv(path: Path, name: str = "x") -> None:
    quoted = name.replace("\r", "").replace("\n", " ")
    rows = [f"{0.01 * k:.2f},{0.01 * k},0.0,{quoted}" for k in range(12)]
    path.write_text("\n".join([f"t,{quoted},v,w", *rows, ""]))


def made(here: Path) -> None:
    """The files of a stranger."""
    shutil.copy(WALL, FILE + ".soter")
    (here / "wrong.soter").write_text(f"soter 1;\nconst {EVIL}: int = 3;\n")
    (here / "import.soter").write_text(f'soter 1;\nimport "{EVIL}.soter";\n')
    mcap(here / "names.mcap")
    frames = [{"header": {"frame_id": name}} for name in ("odom", EVIL)]
    mcap(here / "frames.mcap", "/pose", lambda k: {"x": 0.1, "v": 0.0, **frames[k % 2]})
    mcap(here / "texts.mcap", "/pose", lambda k: {"x": EVIL if k == 5 else 0.1, "v": 0.0})
    (here / "ok.json").write_text(mapping())
    (here / "frame.json").write_text(mapping(frame_id="odom"))
    (here / "where.json").write_text(mapping(where={"w": "7000"}))
    (here / "key.json").write_text(mapping(**{EVIL: 1}))
    (here / "field.json").write_text(mapping(fields={"x": EVIL, "v": "v"}))
    (here / "topic.json").write_text(json.dumps({"system": "Protected", "topics": {EVIL: {}}}))
    (here / "channel.json").write_text(mapping(channel=EVIL + "c"))
    (here / "system.json").write_text(json.dumps({"system": EVIL, "topics": {}}))
    (here / "key.toml").write_text(f"{json.dumps(EVIL)} = 1\n")
    csv(here / "columns.csv", EVIL)
    topics = {"motion": {"fields": {"x": "x", "v": "v"}}}
    (here / "csv.json").write_text(json.dumps({"time": {"from": "t"}, "topics": topics}))
    (here / "px4.ulg").write_bytes(ulog(flight()).replace(b"motion", b"mo\x1bi\nn"))
    mcap(here / "other.mcap", EVIL.replace("pwned", "pose"))
    log = dataflash_text(flight()).decode().replace("Mode AUTO, by 255", EVIL)
    (here / "ap.log").write_text(log)
    for folder, name in (("proof", "manifest.json"), ("camp", "campaign.json")):
        (here / folder).mkdir()
        (here / folder / name).write_text(json.dumps({EVIL: EVIL, "format": EVIL}))
    (here / "proof" / "SEAL").write_text(EVIL)
    for name, kind in (("t.trace", "soter trace"), ("c.counterexample", "counterexample")):
        told = {"kind": kind, "schema": 1, "version": 1, "module": EVIL, "program": EVIL, EVIL: 1}
        (here / f"{name}.json").write_text(json.dumps(told))
    (here / "times.json").write_text(json.dumps({"format": EVIL, EVIL: 1}))
    (here / "hazards.csv").write_text(f"hazard,{EVIL}\n1,2\n")
    (here / "p.onnx").write_bytes(EVIL.encode())


def monitor(log: str, map_: str, *more: str) -> tuple[str, ...]:
    return ("monitor", WALL, log, "--system", "Protected", "--map", map_, *more)


MAPPED = monitor("names.mcap", "ok.json")
PRINTING: list[tuple[str, ...]] = [
    ("check", FILE + ".soter"),
    ("check", "wrong.soter"),
    ("check", "import.soter", "--format", "github"),
    ("fmt", "--check", "wrong.soter"),
    ("fmt", "--check", FILE + ".soter"),
    ("run", FILE + ".soter", "--system", "Protected", "--until", "20ms"),
    ("show", FILE + ".soter"),
    ("explain", EVIL),
    ("new", EVIL),
    ("build", FILE + ".soter", "-o", "out" + FILE),
    ("build", WALL, "--target", "ros1", "--map", "key.toml", "-o", "out"),
    ("run", WALL, "--set", f"{EVIL}=1"),
    ("check", WALL, "--times", "times.json"),
    ("recheck", "proof"),
    ("recheck", FILE),
    ("replay", "t.trace.json"),
    ("replay", "c.counterexample.json"),
    ("policy", "p.onnx"),
    ("campaign", WALL, "--system", "Protected", "--flights", "1", "--until", "20ms", "-o", "camp"),
    ("assure", WALL, "--hazards", "hazards.csv", "-o", "case"),
    ("new", "robot", "--from", "names.mcap"),
    ("new", "robot", "--from", "columns.csv"),
    MAPPED,
    (*MAPPED, "--format", "github"),
    (*MAPPED, "--format", "junit"),
    (*MAPPED, "--format", "sarif"),
    monitor("frames.mcap", "frame.json"),
    monitor("frames.mcap", "frame.json", "--format", "github"),
    monitor("texts.mcap", "ok.json"),
    monitor("names.mcap", "where.json"),
    monitor("names.mcap", "key.json"),
    monitor("names.mcap", "field.json"),
    monitor("names.mcap", "topic.json"),
    monitor("names.mcap", "channel.json"),
    ("monitor", WALL, "names.mcap", "--map", "system.json"),
    monitor("columns.csv", "csv.json"),
    monitor("px4.ulg", "ok.json"),
    monitor("other.mcap", "channel.json"),
    monitor("ap.log", "ok.json"),
    monitor("names.mcap", FILE),
    monitor("names.mcap", "ok.json", "--where", f"{EVIL}={EVIL}"),
]


def test_there_are_30_commands_and_more() -> None:
    assert len(set(PRINTING)) >= 30


@pytest.mark.parametrize("words", PRINTING, ids=lambda w: safe(" ".join(w))[:40].replace(" ", "_"))
def test_no_text_of_a_stranger_acts_upon_a_terminal_or_commands_github(
    soter: Soter, here: Path, words: tuple[str, ...]
) -> None:
    made(here)
    done = soter(*words)
    assert done.exit != 70
    for said in (done.out, done.err):
        assert not ACTING.search(said), said[max(0, ACTING.search(said).start() - 60) :][:120]  # type: ignore[union-attr]
        assert not TAKEN.search(OURS.sub("", said)), said


def test_our_own_colours_and_lines_leave_as_they_are() -> None:
    own = "\x1b[1;31merror\x1b[0m: a\n\tb → ≤ ±\n"
    assert legible(own, color=True) == own
    assert "\x1b" not in legible(own)
    assert legible(f"\x1b[1m{EVIL}\x1b[0m", color=True).count("\x1b") == 2
