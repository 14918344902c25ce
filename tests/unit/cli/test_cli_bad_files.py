"""A small share of bad_input.py: whatever a file holds, a command says so and ends."""

from __future__ import annotations

import json
import os
import signal
import sys
from random import Random
from typing import TYPE_CHECKING

import pytest
from bench.hostile.bad_input_mutants import placed
from bench.hostile.bad_input_samples import (
    HAZARDS,
    MAP,
    NAMED,
    POSITIONS,
    ROOT,
    VIOLATED,
    Format,
    formats,
)

import processes
from long_tests import examples, seeds
from soter.cli.main import main
from soter.report.mcap_log import MAGIC

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path
    from typing import Any

    Soter = Callable[..., Any]

EACH = examples(6)
NAMES = (
    "data_csv",
    "data_json",
    "times",
    "log_csv",
    "map_toml",
    "map_json",
    "test_report",
    "hazards",
)
LIMIT_S = 20
TIMES = {"schema": 1, "program_sha256": "0", "system": "Track", "steps": []}
REPORT = {"program_sha256": "0", "tests": [{"name": "T", "verdict": "clean"}]}


@pytest.fixture
def files(here: Path) -> Iterator[Path]:
    """What the formats need; a test that hangs is ended."""
    track = (ROOT / "examples" / "wall" / "shuttle.soter").read_text(encoding="utf-8")
    texts = {"track.soter": track, "violated.soter": VIOLATED, "data.soter": NAMED}
    texts |= {"map.toml": MAP, "log.csv": POSITIONS, "one.json": "1.25\n"}
    texts |= {"rows.csv": "t,n,on\n1.5,2,true\n2.0,3,false\n0.5,1,true\n"}
    texts |= {"hazards.csv": HAZARDS}
    documents = {"times": TIMES, "report": REPORT, "map": {"system": "Track", "topics": {}}}
    texts |= {f"{name}.json": json.dumps(d) for name, d in documents.items()}
    for name, text in texts.items():
        (here / name).write_text(text)
    signal.alarm(LIMIT_S * EACH)
    yield here
    signal.alarm(0)


@pytest.mark.skipif(sys.platform != "linux", reason="of /dev/zero and /proc")
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.random
def test_a_file_that_is_wrong_is_told_so(files: Path, soter: Soter, name: str) -> None:
    one: Format = formats()[name]
    (path,) = (files / f for f in one.files)
    raw = path.read_bytes()
    for k in seeds(EACH):
        chance = Random(f"{name} {k}")  # noqa: S311 - a test
        how = placed(one, k, chance, files)
        done = soter(*chance.choice(one.commands))
        assert done.exit in (0, 1, 2, 3, 4), (k, how, done.err)
        for left in (path, path.with_name(path.name + ".circle")):
            if left.is_dir() and not left.is_symlink():
                for inside in left.iterdir():
                    inside.unlink()
                left.rmdir()
            left.unlink(missing_ok=True)
        path.write_bytes(raw)


@pytest.mark.skipif(sys.platform != "linux", reason="of /dev/zero")
@pytest.mark.parametrize(
    "command",
    [
        ("check", "cart.soter", "--times", "bad"),
        ("replay", "bad"),
        ("monitor", "cart.soter", "bad"),
        ("monitor", "cart.soter", "bad", "--map", "map.toml"),
        ("monitor", "cart.soter", "cart.soter", "--map", "bad"),
        ("assure", "cart.soter", "--test-report", "bad", "-o", "case"),
        ("assure", "cart.soter", "--hazards", "bad", "-o", "case"),
    ],
    ids=lambda c: f"{c[0]} {c[-1]}",
)
def test_what_is_no_file_is_never_waited_for(
    files: Path, soter: Soter, command: tuple[str, ...]
) -> None:
    bad = files / "bad"
    for make in (
        lambda: os.mkfifo(bad),
        lambda: bad.symlink_to("/dev/zero"),
        lambda: bad.symlink_to(bad),
        lambda: bad.write_bytes(b"\xff\xfe\x00" * 100),
        lambda: bad.write_bytes(MAGIC + b"\x0f" + b"\xff" * 60 + MAGIC),
        lambda: bad.write_bytes(b"[" * 100_000),
    ):
        make()
        done = soter(*command)
        assert done.exit in (1, 2), (command, done.err)
        bad.unlink()


@pytest.mark.parametrize("length", ["99999999999999999999999", "999999999999"])
def test_an_editor_that_says_nonsense_is_told_so(here: Path, length: str) -> None:
    pytest.importorskip("pygls")
    (here / "said").write_text(f"Content-Length: {length}\r\n\r\n{{}}")
    command = [sys.executable, "-m", "soter.cli.main", "lsp"]
    with (here / "said").open("rb") as said:
        done = processes.run(command, cwd=here, capture_output=True, stdin=said)
    assert done.returncode == 1
    assert b"error[D005]: standard input is no stream" in done.stderr


def test_a_compiler_that_says_what_is_no_text(here: Path, soter: Soter) -> None:
    (here / "robot.soter").write_text(
        "soter 1;\ntopic u: float;\nextern node L period 10ms { publishes u; }\n"
        "system S { node L; until 20ms; }\n"
    )
    (here / "bad.c").write_bytes(b'#include "robot.h"\n#error "\xe9\x1b[2J"\nint f(void) {\n')
    done = soter("run", "robot.soter", "--bind", "L=c:bad.c:f")
    assert done.exit == 1
    assert "\x1b" not in done.err
    assert main(["check", "robot.soter"]) == 0


FLY = ("campaign", "cart.soter", "--flights", "2", "--until", "1s", "-o", "camp")
ASSURE = ("assure", "cart.soter", "--campaign", "camp", "--flights", "1", "-o", "case")


def _pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def _infinite(path: Path) -> None:
    document = json.loads(path.read_text())
    path.write_text(json.dumps(document | {"until_ns": float("inf")}))


@pytest.mark.skipif(sys.platform != "linux", reason="of /dev/zero")
@pytest.mark.parametrize(
    ("command", "name", "spoil"),
    [
        (FLY, "flights.csv", lambda p: p.write_bytes(b"a\rb\n1\r2\n")),
        (FLY, "flights.csv", lambda p: p.write_bytes(p.read_bytes() + b"1\r2\n")),
        (FLY, "campaign.lock", _pipe),
        (ASSURE, "flights.csv", lambda p: (p.unlink(), p.symlink_to("/dev/zero"))),
        (ASSURE, "campaign.json", _infinite),
    ],
    ids=["a carriage return", "one at the end", "a pipe for a lock", "/dev/zero", "infinity"],
)
def test_a_damaged_campaign_folder_is_told_so(
    here: Path, soter: Soter, command: tuple[str, ...], name: str, spoil: Callable[[Path], object]
) -> None:
    assert soter(*FLY).exit == 0
    spoil(here / "camp" / name)
    signal.alarm(LIMIT_S)
    done = soter(*command)
    signal.alarm(0)
    assert done.exit in (0, 1), done.err
    assert "I001" not in done.err
