"""The files that commands read, one of each format, and the command lines that read them.

Purpose: `samples` makes a folder with a program and what every command writes for another; of each
`Format` it says which files may be wrong and who reads them; `wrong_options` makes command lines.
Non-goals: making them wrong (`bad_input_mutants.py`).
"""

from __future__ import annotations

import hashlib
import json
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from random import Random

ROOT = Path(__file__).resolve().parents[2]
OPTIONS = "options"
NAMED = """soter 1;
type Row = { t: float, n: int in [0, 9], on: bool };
const ROWS: Row[3] = data "rows.csv";
const ARRAY: float[2][2] = data "array.npy";
const ONE: float = data "one.json";
topic sum: float = 0.0;
topic u: float in [-1.0, 1.0] = 0.0;
node Reader period 10ms {
  publishes sum;
  step {
    var s = ONE + ARRAY[1][0];
    for r in ROWS { s = s + (r.on ? r.t * float(r.n) : 0.0); }
    publish sum = s;
  }
}
extern node Learned period 10ms { subscribes sum; publishes u; }
system S default { node Reader; node Learned; until 50ms; }
"""
PYTHON = """import os
def answer(i):
    return {"u": 0.5}
"""
C = """#include "data.h"
int given(const data_Learned_in *in, data_Learned_out *out) {
  out->u = 0.5 * (in->sum > 1.0);
  out->has_u = true;
  return 0;
}
"""
ANSWERS = """import os, socket, struct
def answer(i):
    said = {}
    for fd, _ in zip(range(3, 64), range(61)):
        try:
            os.write(fd, said) if isinstance(said, bytes) else None
        except OSError:
            pass
    return said
"""
MAP = """system = "Track"
[time]
from = "t"
unit = "s"
[topics."position".fields]
value = "x"
[topics."goal".fields]
value = { constant = 12.0 }
[topics."speed".fields]
value = { from = "v", unit = "m/s", scale = 1.0 }
"""
POSITIONS = "t,x,v\n" + "".join(f"{k * 0.01:.2f},{k * 0.01:.3f},1.0\n" for k in range(60))
VIOLATED = """soter 1;
topic n: int in [0, 20] = 0;
topic by: int in [1, 2] = 1;
plant Count period 10ms {
  reads by;
  drives n = k;
  state k: int in [0, 20] = 0;
  next k = min(20, k + by);
}
node Chooser period 10ms { publishes by; step { publish by = choose { 1, 2 }; } }
system S default { c: Count; node Chooser; until 100ms; always n < 9; }
test T { system S; horizon 100ms; }
"""
MADE = {
    "times": ("measure track.soter --samples 100 --until 200ms -o times.json", ""),
    "log_mcap": ("run track.soter --until 500ms --engine interp --log log.mcap", ""),
    "trace": ("test violated.soter --test T", ".soter/*.trace.json"),
    "counterexample": ("verify refuted.soter", ".soter/*.counterexample.json"),
    "certificate": ("verify track.soter --cert proof", ""),
    "campaign": ("campaign track.soter --flights 3 --until 1s --arms paper -o camp", ""),
    "test_report": ("test violated.soter --test T --json", ""),
}
"""Format -> the command that writes its file, and where else it looks for it."""
HAZARDS = (
    "kind,id,text,traces_to,owner,validation,evidence\n"
    'hazard,H1,"counts, and\nfar",R1; T,,,\nrequirement,R1,stays,always n < 9,,,\n'
    "assumption,scheme,,,somebody,a test,a report\n"
)
SAFE = "safe abs(position) < WALL;"
LATE = " ttf abs(position) > 9.9999; safer abs(position) < 9.99;"
LSP_URI = "file:///tmp/a.soter"


@dataclass(frozen=True)
class Format:
    """A format: files of the sample that may be wrong, and who reads them.

    `json`: whatever they are called; `sealed`: writes the hashes over what was changed; `stdin`:
    the file that is standard input.
    """

    name: str
    files: tuple[str, ...]
    commands: tuple[tuple[str, ...], ...]
    json: bool = False
    sealed: Callable[[Path], None] | None = None
    stdin: str = ""


def formats() -> dict[str, Format]:
    """All formats, by name; files and commands are those of the folder of `samples`."""
    read = ("check", "fmt", "show", "run --until 20ms", "build -o out")
    made = (
        Format(
            "program",
            ("track.soter", "violated.soter"),
            _words(
                *(f"{c} track.soter" for c in read),
                *(f"{c} violated.soter" for c in read),
                "test violated.soter --time 1 --minimise 0",
            ),
        ),
        Format("data_csv", ("rows.csv",), _words("check data.soter")),
        Format("data_json", ("one.json",), _words("check data.soter")),
        Format("data_npy", ("array.npy",), _words("check data.soter")),
        Format(
            "python",
            ("answer.py",),
            _words(
                "run data.soter --bind Learned=python:answer.py:answer",
                "check data.soter --bind Learned=python:answer.py:answer",
            ),
        ),
        Format(
            "c",
            ("answer.c",),
            _words(
                "check data.soter --bind Learned=c:answer.c:given",
                "run data.soter --bind Learned=c:answer.c:given",
            ),
        ),
        Format("times", ("times.json",), _words("check track.soter --times times.json")),
        Format(
            "log_mcap",
            ("log.mcap",),
            _words(
                "monitor track.soter log.mcap",
                "monitor track.soter log.mcap --estimates",
                "monitor track.soter log.mcap --map by_channel.toml",
            ),
        ),
        Format(
            "log_csv",
            ("log.csv",),
            _words(
                "monitor track.soter log.csv --map map.toml",
                "monitor track.soter log.csv --map map.toml --estimates",
            ),
        ),
        Format(
            "log_csv_gz", ("log.csv.gz",), _words("monitor track.soter log.csv.gz --map map.toml")
        ),
        Format("map_toml", ("map.toml",), _words("monitor track.soter log.csv --map map.toml")),
        Format("map_json", ("map.json",), _words("monitor track.soter log.csv --map map.json")),
        Format(
            "trace",
            ("traces/T.trace.json",),
            _words(
                "replay traces/T.trace.json",
                "replay traces/T.trace.json --html out.html",
                "replay traces/T.trace.json --mcap out.mcap",
                "replay traces/T.trace.json --json",
            ),
        ),
        Format(
            "counterexample",
            ("traces/Guard.counterexample.json",),
            _words("replay traces/Guard.counterexample.json"),
        ),
        Format(
            "certificate",
            ("proof/manifest.json", "proof/SEAL", "proof/program/track.soter", *SETS),
            _words("recheck proof", "build shuttle_firmware.soter --cert proof -o out"),
            sealed=seal,
        ),
        Format(
            "campaign",
            ("camp/campaign.json", "camp/flights.csv", "camp/campaign.lock"),
            _words(
                "campaign track.soter --flights 4 --until 1s -o camp",
                "assure track.soter --campaign camp --flights 1 -o case",
                "run track.soter --flight 1 --arm paper --campaign camp --until 20ms",
            ),
        ),
        Format(
            "test_report",
            ("report.json",),
            _words("assure violated.soter --test-report report.json -o case"),
        ),
        Format(
            "hazards",
            ("hazards.csv",),
            _words("assure violated.soter --hazards hazards.csv -o case"),
        ),
        Format("lsp", ("session.lsp",), _words("lsp"), stdin="session.lsp"),
        Format(
            "answers",
            ("answers.py",),
            _words("run data.soter --bind Learned=python:answers.py:answer"),
        ),
    )
    return {f.name: f for f in made}


SETS = ("proof/sets/0_0_0_K.bin", "proof/sets/0_0_0_W.bin", "proof/sets/0_0_0_axis0.bin")


def _words(*lines: str) -> tuple[tuple[str, ...], ...]:
    return tuple(tuple(line.split()) for line in lines)


def seal(folder: Path) -> None:
    """Write the hashes of a certificate over what stands in its folder now."""
    proof = folder / "proof"
    said = proof / "manifest.json"
    if not said.is_file() or said.stat().st_size > 2**24:  # a device, or gigabytes
        return
    manifest = json.loads(said.read_bytes())
    for name in manifest["files"]:
        if (proof / name).is_file() and (proof / name).stat().st_size < 2**24:
            manifest["files"][name] = hashlib.sha256((proof / name).read_bytes()).hexdigest()
    from soter.certificate.reading.folder import canonical_json  # noqa: PLC0415 - not for others

    raw = canonical_json(manifest)
    said.write_bytes(raw)
    (proof / "SEAL").write_text(hashlib.sha256(raw).hexdigest() + "\n")


def samples(folder: Path, names: Sequence[str]) -> None:
    """Make the folder: programs, and what commands wrote of them for the formats of these names."""
    (folder / "traces").mkdir(parents=True)
    wall = ROOT / "examples" / "wall"
    text = (wall / "shuttle.soter").read_text(encoding="utf-8")
    (folder / "track.soter").write_text(text)
    world = (wall / "shuttle_firmware.soter").read_text(encoding="utf-8")
    (folder / "shuttle_firmware.soter").write_text(world.replace("shuttle.soter", "track.soter"))
    (folder / "violated.soter").write_text(VIOLATED)
    (folder / "refuted.soter").write_text(text.replace(SAFE, SAFE + LATE))
    (folder / "data.soter").write_text(NAMED)
    (folder / "answer.py").write_text(PYTHON)
    (folder / "answers.py").write_text(ANSWERS)
    (folder / "answer.c").write_text(C)
    (folder / "rows.csv").write_text("t,n,on\n1.5,2,true\n2.0,3,false\n0.5,1,true\n")
    (folder / "one.json").write_text("1.25\n")
    (folder / "map.toml").write_text(MAP)
    (folder / "log.csv").write_text(POSITIONS)
    _others(folder)
    for name in MADE if OPTIONS in names else [n for n in MADE if n in names]:
        said = soter_says(folder, MADE[name][0])
        if name == "test_report":
            (folder / "report.json").write_bytes(said)
        for trace_file in folder.glob(MADE[name][1] or "none"):
            shutil.move(trace_file, folder / "traces" / trace_file.name.split("-")[-1])
        shutil.rmtree(folder / ".soter", ignore_errors=True)


def _others(folder: Path) -> None:
    """What no command writes: tables, a mapping by channels, the words of an editor."""
    import gzip  # noqa: PLC0415 - only here

    import numpy as np  # noqa: PLC0415 - the same

    np.save(folder / "array.npy", np.array([[1.0, 2.0], [3.0, 4.0]]))
    (folder / "hazards.csv").write_text(HAZARDS)
    (folder / "log.csv.gz").write_bytes(gzip.compress(POSITIONS.encode()))
    fields = {"value": "x"}
    topics = {"position": {"fields": fields}, "goal": {"fields": {"value": {"constant": 12.0}}}}
    document = {"system": "Track", "time": {"from": "t", "unit": "s"}, "topics": topics}
    (folder / "map.json").write_text(json.dumps(document))
    (folder / "by_channel.toml").write_text(
        '[topics.position]\nchannel = "position"\n[topics.position.fields]\nvalue = "value"\n'
    )
    uri, here = {"uri": LSP_URI}, {"line": 1, "character": 3}
    opened = {**uri, "languageId": "soter", "version": 1, "text": "soter 1;\nconst A: int = 3;\n"}
    edit = {"range": {"start": {"line": 1, "character": 0}, "end": here}, "text": "b"}
    changed = {"textDocument": {**uri, "version": 2}, "contentChanges": [edit]}
    said: tuple[tuple[str, Any, int | None], ...] = (
        ("initialize", {"processId": None, "rootUri": None, "capabilities": {}}, 1),
        ("initialized", {}, None),
        ("textDocument/didOpen", {"textDocument": opened}, None),
        ("textDocument/hover", {"textDocument": uri, "position": here}, 2),
        ("textDocument/completion", {"textDocument": uri, "position": here}, 3),
        ("textDocument/didChange", changed, None),
        ("shutdown", None, 4),
        ("exit", None, None),
    )
    stream = b""
    for method, params, number in said:
        message: dict[str, Any] = {"jsonrpc": "2.0", "method": method}
        message |= {} if params is None else {"params": params}
        message |= {} if number is None else {"id": number}
        body = json.dumps(message).encode()
        stream += b"Content-Length: %d\r\n\r\n" % len(body) + body
    (folder / "session.lsp").write_bytes(stream)


def soter_says(folder: Path, words: str) -> bytes:
    """What a command says and writes, which has to be accepted."""
    command = [sys.executable, "-m", "soter.cli.main", *words.split()]
    done = subprocess.run(command, cwd=folder, capture_output=True, check=False)
    assert done.returncode in (0, 3, 4), (words, done.stdout, done.stderr)
    return done.stdout


# ---------------------------------------------------------------- options

WORDS = (
    *("", "-1", "0", "1e999", "nan", "99999999999999999999", "x", "\x1b[2J", "\udcff", "é"),
    *("/dev/zero", "/dev/null", ".", "/", "a" * 5000, "nowhere/x", "--", "-", "out"),
    *("1s", "1h", "0ms", "-1s", "1ns", "2,3", "1,,2", "1G", "0B", "K=V", "K=", "=", "WALL=3"),
    *("Track", "Guard", "T", "S", "paper", "bfs", "falsify", "ample", "c", "posix", "fake"),
    *("sarif", "junit", "native", "interp", "Learned=python:answer.py:answer", "python:x:y"),
    *("Learned=c:answer.c:given", "Learned=python:", "log.mcap", "proof", "camp", "check"),
    *("array.npy", "times.json", "track.soter", "data.soter", "violated.soter"),
)
QUICK = {
    "run": ("--until", "20ms"),
    "monitor": ("--until", "20ms"),
    "campaign": ("--flights", "1", "--until", "20ms"),
    "test": ("--time", "1", "--minimise", "0", "--runs", "5"),
    "measure": ("--samples", "5", "--until", "20ms"),
}
"""So that what is not wrong after all takes no longer than it has to."""
LEFT_OUT = frozenset({"--tcp", "--real-time", "--hours", "--stdio"})


def wrong_options(chance: Random, k: int) -> list[str]:
    """Command line `k`: every command in turn, with options that do not fit."""
    from soter.cli.main import COMMANDS, command_parser  # noqa: PLC0415 - in the process that tries

    name = [*COMMANDS][k % len(COMMANDS)]
    words = list(QUICK.get(name, ()))
    actions = [] if name == "help" else command_parser(name)._actions  # noqa: SLF001
    for _ in range(chance.choice((1, 1, 2, 4))):
        options = [a for a in actions if a.option_strings]
        if not options or chance.random() < 0.1:
            words.append(chance.choice(("--no-such", "-x", "--=", *WORDS)))
            continue
        option = chance.choice(options)
        flag = option.option_strings[-1]
        if flag in LEFT_OUT:
            continue
        words.append(flag)
        if option.nargs != 0 and chance.random() < 0.95:
            words.append(chance.choice(WORDS))
    files = ("track.soter", "track.soter", "violated.soter", *WORDS)
    words += chance.choices(files, k=chance.choice((0, 1, 1, 1, 2)))
    return [name, *words]
