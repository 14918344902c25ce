"""A log that is none of those that are read: what it is, by its first bytes, and what converts it.

Purpose: help for whoever has a file of PX4, ArduPilot or MATLAB, or one under a wrong name.
Non-goals: reading them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.load.bounded_read import opened

if TYPE_CHECKING:
    from pathlib import Path

READ = (
    "read are `.csv`, `.csv.gz`, `.mcap`, `.bag` of ROS 1, and folders or `.db3` of ROS 2, by what "
    "they are called: docs/real-logs.md"
)
ARDUPILOT = (
    "`mavlogdump.py --format csv --types TYPE FILE` of the package `pymavlink` writes a CSV of one "
    "type of its messages"
)
IN_UTF_8 = "`iconv -f UTF-16 -t UTF-8 FILE` writes it in UTF-8, as a CSV is here"
BY_MAGIC = (
    (b"ULog\x01\x12\x35", "a ULog of PX4: `ulog2csv FILE` of the package `pyulog` writes its CSVs"),
    (b"\xa3\x95", f"a DataFlash log of ArduPilot: {ARDUPILOT}"),
    (b"\x89MCAP0\r\n", "an MCAP: its name ends in `.mcap`"),
    (b"#ROSBAG V2.0", "a bag of ROS 1: its name ends in `.bag`"),
    (b"SQLite format 3\0", "a database: that of a bag of ROS 2 ends in `.db3`"),
    (b"\x28\xb5\x2f\xfd", "packed by zstd: unpack it, or give the folder of the bag it is of"),
    (b"\x1f\x8b", "packed by gzip: a CSV so packed ends in `.csv.gz`; unpack anything else"),
    (b"PAR1", "Parquet: `pandas.read_parquet(FILE).to_csv(NEW)` in Python writes a CSV"),
    (b"\x89HDF\r\n", "HDF5, as MATLAB writes it, too: its `writetable` writes a CSV"),
    (b"MATLAB 5.0", "a MAT-file: MATLAB's `writetable` writes a CSV"),
    (b"\xff\xfe", f"a text in UTF-16: {IN_UTF_8}"),
    (b"\xfe\xff", f"a text in UTF-16: {IN_UTF_8}"),
    (b"PK\x03\x04", "a ZIP, or a table of Excel: unpack it, or save the table as a CSV"),
)
BY_ENDING = {".tlog": f"a telemetry log of MAVLink: {ARDUPILOT}"}


def remedies(path: Path) -> tuple[str, ...]:
    """What it seems to be, where that is known, and what is read."""
    try:
        with opened(path, pipes=False) as file:
            head = file.read(64)
    except OSError:
        return (READ,)
    told = next((text for magic, text in BY_MAGIC if head.startswith(magic)), None)
    told = told or BY_ENDING.get(path.suffix.lower())
    if told is None and b"," in head and head.isascii() and path.suffix.lower() != ".csv":
        told = "a CSV, perhaps: its name ends in `.csv`"
    return (READ,) if told is None else (f"it looks like {told}", READ)
