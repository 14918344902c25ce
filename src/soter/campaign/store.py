"""The folder of a campaign: the identity of what is flown, and a line for each flight.

Purpose: `FlightOutcome` and `MetricSample` are one flight as plain data. `CampaignStore` loses no
flight, whenever it is stopped: a campaign goes on where it was. `write_parquet` writes
`flights.parquet` beside `flights.csv`, with the same columns, for other readers of tables.
Non-goals: flying (`batch_flights.py`), statistics.

`campaign.json` says what is flown; `flights.csv` has a line a flight, in the order of their
numbers, each written whole. A line that is torn at the end is flown again.
"""

from __future__ import annotations

import csv
import hashlib
import json
import os
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from importlib.util import find_spec
from typing import IO, TYPE_CHECKING
from zlib import crc32

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.diagnostics.system_texts import reason
from soter.language.load.named_files import read_bytes
from soter.report.atomic_write import require_no_links
from soter.version import pip_command, why_format_is_unreadable

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path


@dataclass(frozen=True)
class MetricSample:
    """A measure over one flight: how many samples were numbers; their sum, ends and histogram.

    `bins`: (bins + 2,) counts; the first is below the range, the last above.
    """

    count: int
    sum: float
    least: float
    most: float
    bins: tuple[int, ...]


@dataclass(frozen=True)
class FlightOutcome:
    """The outcome of a flight. Shares and times are by module, in the system's order.

    `soter run --seed` flies `seed` again; `digest`: SHA-256 over events and last state. `all_ac_s`:
    how long all modules were in AC at once. `violations`: how often a property began to be
    violated, plus how many components latched; `broken`: their texts; `first_s`: when the first
    occurred. `saves`: the number of episodes that end in a violation if AC flies on; `precautions`:
    the number of others; both () if not counted. `looks`: a sample set for each measure.
    `trajectory`: SHA-256 of what happened, without the seed; flights with equal values are copies.
    """

    number: int
    seed: int
    seconds: float
    ac_s: tuple[float, ...]
    all_ac_s: float
    disengagements: tuple[int, ...]
    episodes: tuple[int, ...]
    gate_faults: tuple[int, ...]
    violations: int
    first_s: float | None
    broken: tuple[str, ...]
    digest: str
    trajectory: str
    saves: tuple[int, ...] = ()
    precautions: tuple[int, ...] = ()
    looks: tuple[MetricSample, ...] = ()


ABOUT, FLIGHTS = "campaign.json", "flights.csv"
FLIGHTS_MAX = 2**32
"""Bytes of the table of a campaign at most."""
WORDS = {
    "program_sha256": "the program (its text, or a file that it reads)",
    "until_ns": "how long a flight is",
    "first_seed": "--seed",
    "params": "--set",
    "horizon_ns": "--saves",
    "lateness": "the lateness that was measured",
    "code_sha256": "the C that Soter makes of it (a parameter, or another version of Soter)",
    "linked": "the C of an extern, or its compiler",
    "unknown": "what can be known of the C of externs",
}
COUNTED = ("ac_s", "disengagements", "episodes", "gate_faults")
SAVED = ("saves", "precautions")
LOOKED = ("count", "sum", "least", "most", "histogram")
SCHEMA = 4
LOCK = "campaign.lock"
ANOTHER = "give another folder with -o, or remove this one"


@dataclass(frozen=True)
class CampaignIdentity:
    """The identity of a campaign: two campaigns are the same if all these fields are equal.

    `code_sha256`: hash of the C that Soter makes and of its run-time; `linked`: hashes, by name, of
    the C of externs, of the files that it includes and of the compiler; `unknown`: why this C may
    depend on something unknown, or ""; if it is not "", no stored flight is used.
    """

    program: str
    program_sha256: str
    system: str
    params: dict[str, str]
    until_ns: int
    first_seed: int
    modules: list[str]
    measures: list[str] = field(default_factory=list)
    horizon_ns: int = 0
    arm: str = ""
    lateness: list[int] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)
    code_sha256: str = ""
    linked: dict[str, str] = field(default_factory=dict)
    unknown: str = ""
    schema: int = SCHEMA


class CampaignStore:
    """The folder of a campaign. Raises D006 if it is not writable or has another campaign."""

    def __init__(self, folder: Path, about: CampaignIdentity) -> None:
        self.folder, self.about = folder, about
        self.flights: list[FlightOutcome] = []
        self._lock: IO[str] | None = None
        try:
            folder.mkdir(parents=True, exist_ok=True)
            require_no_links(folder)
            self._open_folder()
        except SoterError:
            self.close()
            raise
        except OSError as error:
            self.close()
            raise _trouble(folder, reason(error)) from error

    def _open_folder(self) -> None:
        about_file = self.folder / ABOUT
        about = json.dumps(asdict(self.about), indent=2, sort_keys=True)
        if about_file.exists():
            self._require_same(_read_json(about_file), json.loads(about))
            self._lock_folder()
            self.flights = self._read_flights()
            self._require_known_c()
        elif any(p for p in self.folder.iterdir() if not p.name.startswith("arm-")):
            raise _trouble(self.folder, "the folder holds something else", "give another with -o")
        else:
            _write_file(about_file, about + "\n")
            self._lock_folder()
        if not self.flights:
            _write_file(self.folder / FLIGHTS, ",".join(self._column_names()) + "\n")

    def _require_same(self, stored: object, expected: dict[str, object]) -> None:
        """Raises D006 with the differences if the folder holds another campaign."""
        if stored == expected:
            return
        before = stored if isinstance(stored, dict) else {}
        if other := why_format_is_unreadable(before.get("schema"), SCHEMA):
            raise _trouble(self.folder, other, ANOTHER)
        names = [n for n in expected if before.get(n) != expected[n]]
        difference = ", ".join(f"`{WORDS.get(n, n)}`" for n in names) or "what it was about"
        raise _trouble(
            self.folder, f"the folder holds another campaign: {difference} is another", ANOTHER
        )

    def _require_known_c(self) -> None:
        """Raises D006 if the folder has flights that might come out differently now."""
        if self.flights and self.about.unknown:
            raise _trouble(
                self.folder,
                f"its {len(self.flights)} flights cannot be taken: nobody knows whether the C of "
                f"the externs is the same ({self.about.unknown})",
                ANOTHER,
            )

    def _lock_folder(self) -> None:
        """Locks the folder until the process ends. Raises D006 if another process has locked it."""
        try:
            from fcntl import LOCK_EX, LOCK_NB, flock  # noqa: PLC0415 - not everywhere
        except ImportError:
            return
        path = self.folder / LOCK
        if path.exists() and not path.is_file():
            raise _trouble(
                self.folder, f"`{LOCK}` is no file", "remove it, or give another with -o"
            )
        self._lock = path.open("w", encoding="utf-8")
        try:
            flock(self._lock, LOCK_EX | LOCK_NB)
        except BlockingIOError:
            raise _trouble(
                self.folder, "another campaign is being flown into it", "wait, or give -o"
            ) from None

    def close(self) -> None:
        """Unlocks the folder, so that other processes may add flights to it."""
        if self._lock is not None:
            with suppress(OSError):
                self._lock.close()
            self._lock = None

    def _column_names(self) -> list[str]:
        by_module = [f"{m}.{p}" for m in self.about.modules for p in self._module_columns()]
        looks = [f"{m}.{p}" for m in self.about.measures for p in LOOKED]
        fixed = ["number", "seed", "seconds", "violations", "first_s", "all_ac_s"]
        return [*fixed, *by_module, *looks, "broken", "digest", "trajectory", "line"]

    def _module_columns(self) -> tuple[str, ...]:
        return (*COUNTED, *(SAVED if self.about.horizon_ns else ()))

    def _read_flights(self) -> list[FlightOutcome]:
        """Reads the stored flights from number 0 up to a damaged line; cuts off the rest."""
        path = self.folder / FLIGHTS
        if not path.exists():
            return []
        raw = read_bytes(path, FLIGHTS_MAX)
        lines = raw.decode("utf-8", "replace").split("\n")[:-1]
        flights: list[FlightOutcome] = []
        if lines and lines[0] != ",".join(self._column_names()):
            raise _trouble(self.folder, f"`{FLIGHTS}` has other columns", "give another folder")
        with suppress(csv.Error):  # csv also fails at a damaged line
            for row in csv.DictReader(lines):
                flight = self._read_flight(row) if _is_undamaged(row) else None
                if flight is None or flight.number != len(flights):
                    break
                flights.append(flight)
        size = sum(len(line) + 1 for line in raw.split(b"\n")[: len(flights) + 1])
        if flights and size != len(raw):
            with path.open("r+b") as file:
                file.truncate(size)
        return flights

    def _read_flight(self, row: dict[str, str]) -> FlightOutcome | None:
        names = self.about.modules
        try:
            return FlightOutcome(
                number=int(row["number"]),
                seed=int(row["seed"]),
                seconds=float(row["seconds"]),
                ac_s=tuple(float(row[f"{m}.ac_s"]) for m in names),
                all_ac_s=float(row["all_ac_s"]),
                disengagements=tuple(int(row[f"{m}.disengagements"]) for m in names),
                episodes=tuple(int(row[f"{m}.episodes"]) for m in names),
                gate_faults=tuple(int(row[f"{m}.gate_faults"]) for m in names),
                violations=int(row["violations"]),
                first_s=float(row["first_s"]) if row["first_s"] else None,
                broken=tuple(json.loads(row["broken"])) if row["broken"] else (),
                digest=_checked_digest(row["digest"]),
                trajectory=_checked_digest(row["trajectory"]),
                saves=self._saved_numbers(row, "saves"),
                precautions=self._saved_numbers(row, "precautions"),
                looks=tuple(_read_sample(row, m) for m in self.about.measures),
            )
        except (KeyError, ValueError, TypeError):
            return None

    def _saved_numbers(self, row: dict[str, str], column: str) -> tuple[int, ...]:
        if not self.about.horizon_ns:
            return ()
        return tuple(int(row[f"{m}.{column}"]) for m in self.about.modules)

    def add_flights(self, flights: Sequence[FlightOutcome]) -> None:
        """Adds flights after the stored ones. Raises SoterError D006 if that fails."""
        try:
            with (self.folder / FLIGHTS).open("a", encoding="utf-8", newline="") as file:
                writer = csv.writer(file, lineterminator="\n")
                writer.writerows(_flight_cells(f) for f in flights)
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            message = f"{reason(error)}; {len(self.flights)} flights are kept"
            raise _trouble(self.folder, message) from error
        self.flights += flights


def measured_lateness(folder: Path, program_sha256: str | None, system: str) -> tuple[int, ...]:
    """The lateness (ns) with which the arm `paper` was flown. Raises D006 if it was not flown."""
    file = folder / "arm-paper" / ABOUT
    about = _read_json(file) if file.is_file() else None
    if not isinstance(about, dict):
        helps = ("fly it with `soter campaign --arms paper`, or say where it is: `--campaign DIR`",)
        raise _trouble(folder, "no arm `paper` was flown there", *helps)
    if other := why_format_is_unreadable(about.get("schema"), SCHEMA):
        raise _trouble(folder, other, "fly its arm `paper` again")
    if (about.get("program_sha256"), about.get("system")) != (program_sha256, system):
        raise _trouble(folder, "its arm `paper` is of another program or system")
    times = about.get("lateness")
    if not isinstance(times, list) or len(times) < 2 or any(type(t) is not int for t in times):
        raise _trouble(folder, f"`{file.name}` of its arm `paper` is damaged")
    return tuple(times)


def _read_sample(row: dict[str, str], name: str) -> MetricSample:
    total, least, most = (float(row[f"{name}.{part}"]) for part in ("sum", "least", "most"))
    bins = tuple(int(x) for x in row[f"{name}.histogram"].split())
    return MetricSample(int(row[f"{name}.count"]), total, least, most, bins)


def _checked_digest(text: str) -> str:
    if len(text) != 64 or not set(text) <= set("0123456789abcdef"):
        raise ValueError(text)
    return text


def _flight_cells(f: FlightOutcome) -> list[object]:
    counted = (f.ac_s, f.disengagements, f.episodes, f.gate_faults)
    by_module = zip(*counted, *((f.saves, f.precautions) if f.saves else ()), strict=True)
    first = "" if f.first_s is None else repr(f.first_s)
    fixed = [f.number, f.seed, repr(f.seconds), f.violations, first, repr(f.all_ac_s)]
    numbers = [repr(x) if isinstance(x, float) else x for m in by_module for x in m]
    for look in f.looks:
        numbers += [look.count, repr(look.sum), repr(look.least), repr(look.most)]
        numbers.append(" ".join(map(str, look.bins)))
    cells = [*fixed, *numbers, json.dumps(f.broken) if f.broken else "", f.digest, f.trajectory]
    return [*cells, _line_checksum(map(str, cells))]


def _line_checksum(cells: Iterable[str]) -> str:
    return f"{crc32(chr(10).join(cells).encode()):08x}"


def _is_undamaged(row: dict[str, str]) -> bool:
    """Whether the checksum of a row fits its cells."""
    cells = list(row.values())
    return None not in row and None not in cells and cells[-1] == _line_checksum(cells[:-1])


def campaign_digest(flights: Iterable[FlightOutcome]) -> str:
    """The SHA-256 hash over the digests of all flights, in the order of their numbers."""
    digest = hashlib.sha256()
    for f in flights:
        digest.update(f"{f.number} {f.seed} {f.digest}\n".encode("ascii"))
    return digest.hexdigest()


def _read_json(path: Path) -> object:
    try:
        return json.loads(read_bytes(path))
    except (ValueError, RecursionError):
        return None


def _write_file(path: Path, text: str) -> None:
    beside = path.with_suffix(".part")
    beside.write_text(text, encoding="utf-8")
    beside.replace(path)


def _trouble(folder: Path, message: str, *helps: str) -> SoterError:
    return SoterError((Diagnostic("D006", f"`{folder}`: {message}", helps=helps),))


PARQUET = "flights.parquet"


def require_parquet() -> None:
    """Raises SoterError D007 if the package that writes Parquet is not installed."""
    if find_spec("pyarrow") is None:
        message = "Parquet is written with the package `pyarrow`, which is not installed"
        helps = (f"install it: {pip_command('cluster')}; `flights.csv` says the same",)
        raise SoterError((Diagnostic("D007", message, helps=helps),))


def write_parquet(folder: Path) -> Path:
    """Writes a campaign's flights as Parquet and returns the path. Raises D006 or D007."""
    require_parquet()
    from pyarrow import csv, parquet  # noqa: PLC0415 - an extra

    target = folder / PARQUET
    beside = target.with_suffix(".part")
    try:
        parquet.write_table(csv.read_csv(folder / FLIGHTS), beside)
        beside.replace(target)
    except OSError as error:
        message = f"`{target}`: {reason(error)}"
        raise SoterError((Diagnostic("D006", message),)) from error
    return target
