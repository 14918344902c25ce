"""Files that are no logs that are read: what they are is told, and what converts them.

And what is read of a file counts once against the limit of what it may unpack to.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("rosbags", reason="the extra `logs` is not installed")
pytest.importorskip("mcap_protobuf", reason="the extra `logs` is not installed")

from generators.robot_logs import CART, MS, T0, TYPED, Recorded, as_bag1, odometry, refused
from soter.api import load
from soter.cli.main import main
from soter.diagnostics.diagnostic import SoterError
from soter.report import bounded_unpack
from tables import all_rows

if TYPE_CHECKING:
    from pathlib import Path

OTHERS = [
    ("flight.ulg", b"FMT, 128, 89, FMT", "ends in `.log`"),
    ("flight.mcap", b"ULog\x01\x12\x35\x01", "ends in `.ulg`"),
    ("flight.ulg", b"\xa3\x95\x80\x80", "ends in `.bin`"),
    ("flight.bin", b"\x89MCAP0\r\n", "ends in `.mcap`"),
    ("flight.bag", b"\x89MCAP0\r\n", "its name ends in `.mcap`"),
    ("flight.mcap", b"#ROSBAG V2.0\n", "its name ends in `.bag`"),
    ("flight.mcap", b"SQLite format 3\0", "ends in `.db3`"),
    ("flight.mcap.zstd", b"\x28\xb5\x2f\xfd", "unpack it"),
    ("flight.bag", b"\x1f\x8b\x08", "unpack anything else"),
    ("flight.parquet", b"PAR1", "pandas.read_parquet"),
    ("flight.mat", b"MATLAB 5.0 MAT-file", "writetable"),
    ("flight.xlsx", b"PK\x03\x04", "save the table as a CSV"),
    ("flight.txt", "t,x,v\n".encode("utf-16"), "iconv -f UTF-16"),
    ("flight.txt", b"t,x,v\n0,1,2\n", "its name ends in `.csv`"),
    ("flight.mcap", b"", "docs/real-logs.md"),
]


@all_rows(("name", "head", "told"), OTHERS)
def test_a_file_of_another_format_is_told_what_converts_it(
    tmp_path: Path, name: str, head: bytes, told: str
) -> None:
    log = tmp_path / name
    log.write_bytes(head)
    said = refused(log)
    assert told in said
    assert "read are `.csv`, `.csv.gz`, `.mcap`, `.bag` of ROS 1" in said


def test_a_log_of_soter_is_not_told_by_the_numbers_of_its_first_bytes(
    tmp_path: Path, capsys: Any
) -> None:
    log = tmp_path / "flight.ulg"
    log.write_bytes(b"ULog\x01\x12\x35\x01")
    assert main(["monitor", str(CART), str(log), "--system", "Protected"]) == 1
    said = capsys.readouterr().err
    assert "it is no MCAP file" in said
    assert "needs `--map FILE`" in said


def test_a_table_that_is_none_is_told_what_it_is(tmp_path: Path) -> None:
    log = tmp_path / "flight.csv"
    log.write_bytes(b"\x89MCAP0\r\n")
    topics = {"motion": {"fields": {"x": "x", "v": "v"}}}
    with pytest.raises(SoterError) as error:
        load(CART).judge_log(log, {"time": {"from": "t"}, "topics": topics}, system="Protected")
    assert "its name ends in `.mcap`" in error.value.diagnostics[0].helps[0]


@pytest.mark.parametrize("packed", ["", "BZ2", "LZ4"])
def test_chunks_whose_times_overlap_count_once(
    tmp_path: Path, packed: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two sources, one behind the other in the file: by times each message is in another chunk."""
    from rosbags.rosbag1 import Writer

    init = Writer.__init__

    def small_chunks(self: Any, path: Path) -> None:
        init(self, path)
        self.chunk_threshold = 20_000

    monkeypatch.setattr(Writer, "__init__", small_chunks)
    times = [T0 + k * 10 * MS for k in range(200)]
    flight = [
        Recorded(t, odometry(t - MS, 0.001, 0.1), channel)
        for channel in ("/odom", "/camera")
        for t in times
    ]
    as_bag1(tmp_path / "two.bag", flight, packed)
    monkeypatch.setattr(bounded_unpack, "UNPACKED_MIN", 400 * 1000)
    monkeypatch.setattr(bounded_unpack, "UNPACKED_RATIO", 0)
    promise = {**TYPED, "every": "10ms", "delayed": "5ms"}
    sources = [promise, {**promise, "channel": "/camera", "after": "15ms"}]
    given = {"system": "Protected", "topics": {"motion": {"sources": sources}}}
    (module,) = load(CART).judge_log(tmp_path / "two.bag", given).modules
    assert (module.judged, module.stale) == (True, 0)
