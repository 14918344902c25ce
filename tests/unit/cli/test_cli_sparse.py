"""Files that say of themselves that they are 20 GB: each is refused at once, in words."""

from __future__ import annotations

import gzip
import zlib
from typing import TYPE_CHECKING

import pytest

from soter.api.assurance.evidence import read_flights
from soter.diagnostics.diagnostic import SoterError
from soter.language.load.named_files import ReadError, read_bytes
from soter.monitor.log_files import csv_log
from soter.native.cache import cache_limit
from soter.targets.package import Package, PackageFile

if TYPE_CHECKING:
    from pathlib import Path

SIZE = 20 * 2**30


def sparse(path: Path, start: bytes = b"") -> Path:
    """A file of 20 GB that begins so; nothing of the rest stands on the disk."""
    path.write_bytes(start)
    with path.open("r+b") as file:
        file.truncate(SIZE)
    return path


def test_a_file_of_a_package(tmp_path: Path) -> None:
    sparse(tmp_path / "a.c")
    sparse(tmp_path / ".soter-files.json")
    with pytest.raises(SoterError) as caught:
        Package(tmp_path, [PackageFile("a.c", "int x;\n")]).write()
    assert [d.code for d in caught.value.diagnostics] == ["D008"]


def test_the_limit_of_the_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOTER_CACHE", str(tmp_path))
    monkeypatch.delenv("SOTER_CACHE_MB", raising=False)
    sparse(tmp_path / "limit", b"2048\n")
    with pytest.raises(SoterError) as caught:
        cache_limit()
    assert [d.code for d in caught.value.diagnostics] == ["X006"]


def test_the_flights_of_a_campaign(tmp_path: Path) -> None:
    (tmp_path / "campaign.json").write_text("{}")
    sparse(tmp_path / "flights.csv", b"number\n")
    with pytest.raises(SoterError, match="too large"):
        read_flights(tmp_path)


def test_nothing_is_read_of_what_is_too_large(tmp_path: Path) -> None:
    """However large the limit is: 4 GB of zeros were read before."""
    with pytest.raises(ReadError, match="too large"):
        read_bytes(sparse(tmp_path / "a"), 2**34)


def test_zeros_behind_what_gzip_has_packed(tmp_path: Path) -> None:
    path = sparse(tmp_path / "a.gz", gzip.compress(b"t,x\n"))
    with path.open("rb") as file, pytest.raises(zlib.error, match="behind its end"):
        csv_log.BoundedGzip(file).readall()


def test_what_gzip_reads_is_read(tmp_path: Path) -> None:
    """Several members, and zeros between and behind them."""
    parts = [bytes([k]) * 200_000 for k in range(3)]
    path = tmp_path / "a.gz"
    path.write_bytes(b"".join(gzip.compress(p) + b"\0" * 100 for p in parts))
    with path.open("rb") as file:
        assert csv_log.BoundedGzip(file).readall() == b"".join(parts)


def test_a_cut_and_an_endless_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole, path = gzip.compress(b"x" * 10_000_000), tmp_path / "a.gz"
    path.write_bytes(whole[:-20])
    with path.open("rb") as file, pytest.raises(EOFError):
        csv_log.BoundedGzip(file).readall()
    path.write_bytes(whole)
    monkeypatch.setattr(csv_log, "UNPACKED_MAX", 1_000_000)
    with path.open("rb") as file, pytest.raises(zlib.error, match="more than"):
        csv_log.BoundedGzip(file).readall()


def test_a_high_limit_takes_no_memory_for_what_is_not_there(tmp_path: Path) -> None:
    (tmp_path / "small").write_bytes(b"x" * 3)
    assert read_bytes(tmp_path / "small", 2**60) == b"xxx"
    with pytest.raises(ReadError, match="too large"):
        read_bytes(tmp_path / "small", 2)
