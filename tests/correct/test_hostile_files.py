"""A small share of `bench/hostile/hostile_files.py`: nothing runs, leaves its folder, grows, hangs.

And the page of what is executed names no kind of file that is not tried there.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest
from bench.hostile.bad_input_samples import formats
from bench.hostile.hostile_crafted import CRAFTED
from bench.hostile.hostile_samples import MORE

import processes

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "what-runs.md"
TRIED = (*formats(), *(f.name for f in MORE))
CODE = {"python", "c"}
"""What a program binds is executed."""
KINDS = {
    "a program": {"program", "imported"},
    "data": {"data_csv", "data_json", "data_npy"},
    "a certificate": {"certificate"},
    "a log": {
        *("log_csv", "log_csv_gz", "log_mcap", "mcap_ros", "mcap_loose"),
        *("bag", "bag_alone", "bag_mcap", "bag_zstd", "bag_ros1"),
    },
    "a mapping": {"map_toml", "map_json", "message"},
    "a dialect": {"dialect"},
    "a policy in ONNX": {"policy_onnx", "onnx_beside"},
    "a policy of Stable-Baselines3": {"policy_sb3", "vecnormalize"},
    "hazards": {
        *("hazards", "times", "lateness", "test_report", "trace", "counterexample"),
        *("campaign", "package"),
    },
    "what an editor says": {"lsp", "playground", "channels"},
    "a board": set(),
}
"""How rows of the page begin -> the formats that are tried of them; a board is compiled."""
PACKAGES = ("onnx", "onnxruntime", "rosbags", "mcap", "pymavlink", "pygls", "zstandard")
QUICK = "data_npy,policy_onnx"


def test_every_kind_of_file_of_the_page_is_tried() -> None:
    text = PAGE.read_text(encoding="utf-8").split("## Files that are read as data")[1]
    rows = [
        x for x in re.findall(r"^\| ([^|]+) \|", text, re.MULTILINE) if x not in ("file", "---")
    ]
    assert len(rows) == len(KINDS)
    assert all(any(row.startswith(kind) for kind in KINDS) for row in rows)
    assert set().union(*KINDS.values()) == set(TRIED) - CODE - {"answers"}
    assert set(CRAFTED) <= set(TRIED)


def nothing_wrong(*words: str) -> None:
    for package in PACKAGES:
        pytest.importorskip(package, reason=f"the package is absent: {package}")
    command = [sys.executable, str(ROOT / "bench" / "hostile" / "hostile_files.py"), *words]
    done = processes.run(command, capture_output=True)
    assert done.returncode == 0, done.stdout.decode() + done.stderr.decode()
    assert b" 0 wrong; target 0" in done.stdout


@pytest.mark.skipif(sys.platform != "linux", reason="of /dev/zero and /proc")
def test_a_few_hostile_files() -> None:
    nothing_wrong("--each", "4", "--only", QUICK)


@pytest.mark.long
@pytest.mark.skipif(sys.platform != "linux", reason="of /dev/zero and /proc")
@pytest.mark.parametrize("name", [n for n in TRIED if n not in CODE])
def test_thirty_hostile_files_of_each_format(name: str) -> None:
    nothing_wrong("--only", name)
