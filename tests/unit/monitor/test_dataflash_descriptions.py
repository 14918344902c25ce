"""What a DataFlash log says of its messages: a `FMT` or a `FMTU` that fits nothing is damage.

Where it was stepped over, two sensors were read as one, or the reader ended with an error of its
own.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from generators.autopilot_logs import FMTU, dataflash, dataflash_text, flight, written
from soter.diagnostics.diagnostic import SoterError
from soter.monitor.log_files.log_columns import FileFacts, Wanted
from soter.monitor.log_files.read_columns import channel_messages
from tables import all_rows

if TYPE_CHECKING:
    from pathlib import Path

MAKERS = {"flight.BIN": dataflash, "flight.log": dataflash_text}


def poses(log: Path, facts: FileFacts | None = None) -> int:
    """How many messages of the first instance there are."""
    arrived = channel_messages(log, {"POSE": Wanted()}, facts or FileFacts())
    return sum(channel == "POSE" for _, _, channel, _ in arrived)


DAMAGES = (
    ("the units of a kind that is not", "flight.log", b", 129, s#mnd", b", 29, s#mnd"),
    ("a kind under another number", "flight.log", b"FMT, 129, ", b"FMT, 19, "),
    ("a unit that is lost", "flight.log", b"s#mnd", b"smnd"),
    ("a unit more", "flight.log", b"s#mnd", b"ss#mnd"),
    ("a comma more", "flight.log", b"129, s#mnd", b"129,, s#mnd"),
    ("units without a kind", "flight.log", b",FmtType,", b",FmtTyp,"),
    ("units without units", "flight.log", b",UnitIds,", b",UnitId,"),
    ("the kind of kinds under another number", "flight.log", b"FMT, 128, 89", b"FMT, 28, 89"),
    ("two kinds of kinds", "flight.log", b" FMTU, QBNN", b" FMT, QBNN"),
    ("two kinds of kinds", "flight.BIN", b"FMTUQBNN", b"FMT\0QBNN"),
    ("the units of a kind that is not", "flight.BIN", b"\x81s#mnd", b"\x21s#mnd"),
    ("a unit that is lost", "flight.BIN", b"s#mnd\0", b"smnd\0\0"),
    ("units without a kind", "flight.BIN", b",FmtType,", b",FmtTypo,"),
)


@all_rows(
    ("name", "was", "damaged"), [d[1:] for d in DAMAGES], ids=[f"{d[1]}: {d[0]}" for d in DAMAGES]
)
def test_a_description_that_fits_no_kind_is_damage(
    tmp_path: Path, name: str, was: bytes, damaged: bytes
) -> None:
    data = MAKERS[name](flight())
    assert poses(written(tmp_path / name, data)) == 40
    assert data.count(was) == 1
    with pytest.raises(SoterError, match="D016"):
        poses(written(tmp_path / name, data.replace(was, damaged)))


def test_erased_flash_that_may_have_cut_the_last_message_is_told(tmp_path: Path) -> None:
    data, facts = dataflash(flight()), FileFacts()
    assert poses(written(tmp_path / "flight.BIN", data + b"\xff" * 40), facts) == 40
    assert poses(written(tmp_path / "flight.BIN", data[:-9] + b"\xff" * 49), facts) == 40
    whole, torn = facts.notes
    assert torn == f"{whole}, and its last message may be torn"


def without_units(data: bytes) -> bytes:
    """The log without the one `FMTU`, which says which field of `POSE` is the instance."""
    text = data.startswith(b"FMT")
    begin = data.index(b"FMTU, 5" if text else b"\xa3\x95\x82")
    end = data.index(b"\n", begin) + 1 if text else begin + FMTU[1]
    return data[:begin] + data[end:]


@all_rows("name", list(MAKERS))
def test_sensors_that_nobody_tells_apart_are_told(tmp_path: Path, name: str) -> None:
    data, facts = MAKERS[name](flight()), FileFacts()
    assert poses(written(tmp_path / name, without_units(data)), facts) == 80
    assert facts.notes == ["no `FMTU` says which of its sensors a `POSE` is of"]


@all_rows("name", list(MAKERS))
def test_one_description_with_an_instance_and_one_without_contradict_each_other(
    tmp_path: Path, name: str
) -> None:
    data = MAKERS[name](flight())
    with pytest.raises(SoterError, match="contradict each other"):
        poses(written(tmp_path / name, data + data.replace(b"s#mnd", b"s-mnd")))
