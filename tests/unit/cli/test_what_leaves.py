"""Texts of strangers in what commands print: nothing acts upon a terminal or commands GitHub.

Names of files, of channels, columns, frames and keys, words of tables and traces are a stranger's
wherever a log, a mapping, a proof or a program comes from one. Whatever a command makes of them:
no control character is printed, and no line begins that the stranger wrote.
Non-goals: JSON, which escapes; pages, whose templates do (`tests/unit/report`).
"""

from __future__ import annotations

import json
import re
import shutil
from typing import TYPE_CHECKING, Any

import pytest

from generators.autopilot_logs import dataflash_text, flight, ulog
from soter.diagnostics.diagnostic import legible
from soter.diagnostics.render import safe

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    Soter = Callable[..., Any]

EVIL = (
    "a\x1b[31m\x1b]0;t\x07\x9b31m\r\n::error::pwned\n  ::add-mask::x\n##[error]pwned\u202e\u2028b"
)
"""A name that colours, moves and names a terminal, and speaks to GitHub."""
FILE = EVIL.replace("/", "_")
CONTROLS = re.compile("[\0-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069\u2028\u2029]")
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
COMMANDS: list[tuple[str, ...]] = [
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
    assert len(set(COMMANDS)) >= 30


@pytest.mark.parametrize("words", COMMANDS, ids=lambda w: safe(" ".join(w))[:40].replace(" ", "_"))
def test_no_text_of_a_stranger_acts_upon_a_terminal_or_commands_github(
    soter: Soter, here: Path, words: tuple[str, ...]
) -> None:
    made(here)
    done = soter(*words)
    assert done.exit != 70
    for said in (done.out, done.err):
        assert not CONTROLS.search(said), said[max(0, CONTROLS.search(said).start() - 60) :][:120]  # type: ignore[union-attr]
        assert not TAKEN.search(OURS.sub("", said)), said


def test_our_own_colours_and_lines_leave_as_they_are() -> None:
    own = "\x1b[1;31merror\x1b[0m: a\n\tb → ≤ ±\n"
    assert legible(own, color=True) == own
    assert "\x1b" not in legible(own)
    assert legible(f"\x1b[1m{EVIL}\x1b[0m", color=True).count("\x1b") == 2
