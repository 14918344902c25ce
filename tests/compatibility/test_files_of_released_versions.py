"""Files of released versions are read with the verdict that they had, or refused in words.

A folder here holds what a version wrote (`make_corpus.py`). Files of versions that do not exist
yet, and damaged ones, are made of them: each is refused with a code and with what to do.
"""

from __future__ import annotations

import hashlib
import json
import re
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import pytest

import soter
from json_documents import SCHEMAS, problems_of_fields
from soter.certificate.reading.folder import canonical_json
from soter.certificate.report import ACCEPTED, NOT_RECHECKED
from soter.cli.main import main
from soter.diagnostics.diagnostic import Severity
from soter.mapping.read_mapping import make_log_map, read_mapping, system_name
from soter.remote.channels_json import find_topics
from tables import all_rows

if TYPE_CHECKING:
    from collections.abc import Callable

HERE = Path(__file__).parent
RELEASES = sorted(path.parent for path in HERE.glob("*/programs"))
CERTIFICATES = {"0.1.0": NOT_RECHECKED}
"""By version, what a re-check of its certificates comes to; of any other one they are accepted."""
GONE = {
    "0.1.0/programs/wall/tower.soter": ["S026"],
    "0.1.0/programs/generality/gimbal.soter": ["S026"],
    "0.1.0/programs/wall/lift.soter": ["S026"],
}
"""Programs that name what is gone, with the one error that each gets."""
OF_MAPPINGS = {
    "fleet": "vehicle.soter",
    "mavlink": "geofence.soter",
    "drone": "goto.soter",
    "ground_robot": "ground_robot.soter",
    "shuttle_ros": "shuttle_ros.soter",
}
"""The program of a mapping, by its folder or by how its name begins."""
CART = "programs/wall/cart.soter"


def files(pattern: str) -> list[Path]:
    """The files of all releases."""
    return [path for release in RELEASES for path in sorted(release.glob(pattern))]


def name_of(path: object) -> str:
    """A file below this folder."""
    return str(path.relative_to(HERE)) if isinstance(path, Path) else str(path)


def release_of(path: Path) -> Path:
    """The folder of the version that wrote a file."""
    return HERE / path.relative_to(HERE).parts[0]


class Ended(NamedTuple):
    """What a command came to."""

    exit: int
    document: dict[str, Any]

    @property
    def told(self) -> str:
        """Messages with their codes, notes and helps."""
        return json.dumps(self.document, ensure_ascii=False)


@pytest.fixture
def command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., Ended]:
    """A command line, in an empty folder; its document."""
    monkeypatch.chdir(tmp_path)

    def run(*words: object) -> Ended:
        code = main([*map(str, words), "--json"])
        return Ended(code, json.loads(capsys.readouterr().out))

    return run


# ---------------------------------------------------------------- what a release wrote


def right_programs() -> list[tuple[Path, str]]:
    """The programs that a release found right, with their hashes."""
    listed = {path: json.loads(path.read_text("utf-8")) for path in files("programs.json")}
    return [
        (p.parent / name, sha256) for p, those in listed.items() for name, sha256 in those.items()
    ]


@all_rows(("path", "sha256"), right_programs(), ids=name_of)
def test_a_program_is_right_as_it_was(path: Path, sha256: str) -> None:
    """No errors but of what is gone; and it is the one that certificates speak of."""
    program = soter.load(path)
    errors = [d.code for d in program.diagnostics if d.severity is Severity.ERROR]
    assert errors == GONE.get(name_of(path), []), program.diagnostics
    if program.ok:
        assert program.sha256 == sha256


@all_rows("path", files("certificates/*"), ids=name_of)
def test_a_certificate_is_accepted_or_its_remedy_is_told(path: Path) -> None:
    report = soter.recheck(path)
    wanted = CERTIFICATES.get(release_of(path).name, ACCEPTED)
    assert report.verdict == wanted, report
    if wanted == NOT_RECHECKED:
        assert "make it again with `soter verify --cert`" in str(report)


@all_rows("path", files("traces/*.json"), ids=name_of)
def test_a_trace_is_an_execution_of_its_program(path: Path) -> None:
    assert soter.replay(path).reproduced


@all_rows("release", RELEASES, ids=name_of)
def test_a_campaign_goes_on_or_says_why_not(
    release: Path, command: Callable[..., Ended], tmp_path: Path
) -> None:
    shutil.copytree(release / "campaigns" / "cart", tmp_path / "cart")
    before = (tmp_path / "cart" / "flights.csv").read_bytes()
    words = ("--flights", 4, "--until", "5s", "-o", tmp_path / "cart")
    ended = command("campaign", release / CART, *words)
    if ended.exit:
        assert ended.exit == 1
        assert "another version of Soter" in ended.told
        assert "give another folder with -o" in ended.told
    assert (tmp_path / "cart" / "flights.csv").read_bytes() == before


@all_rows("release", RELEASES, ids=name_of)
def test_a_lateness_that_was_measured_is_flown_again(
    release: Path, command: Callable[..., Ended]
) -> None:
    words = ("--flight", 1, "--arm", "paper", "--campaign", release / "campaigns" / "cart")
    assert command("run", release / CART, "--until", "1s", *words).exit == 0


@all_rows("path", files("programs/**/*.toml"), ids=name_of)
def test_a_mapping_fits_its_program(path: Path) -> None:
    pytest.importorskip("rosbags", reason="the types of ROS messages")
    names = [n for n in OF_MAPPINGS if n == path.parent.name or path.name.startswith(n)]
    program = soter.load(path.parent / OF_MAPPINGS[names[0]])
    given = read_mapping(path)
    mapped = make_log_map(given, program.declared(system_name(given)), file=path)
    assert mapped.topics


@all_rows("release", RELEASES, ids=name_of)
def test_a_log_is_judged_as_it_was(release: Path, command: Callable[..., Ended]) -> None:
    then = json.loads((release / "documents" / "monitor.json").read_text(encoding="utf-8"))
    ended = command("monitor", release / CART, release / "logs" / "cart.mcap")
    assert ended.exit == then["exit"]
    for module, judged in then["modules"].items():
        now = ended.document["modules"][module]
        assert {field: now[field] for field in judged} == judged


@all_rows("release", RELEASES, ids=name_of)
def test_times_that_were_measured_are_read(release: Path, command: Callable[..., Ended]) -> None:
    assert command("check", release / CART, "--times", release / "times" / "cart.json").exit == 0


@all_rows("path", files("documents/*.json"), ids=name_of)
def test_what_a_document_had_is_still_documented(path: Path) -> None:
    """A script that reads it finds every field of it today, with its type, or in the changelog."""
    document = json.loads(path.read_text(encoding="utf-8"))
    changelog = (HERE.parents[1] / "CHANGELOG.md").read_text(encoding="utf-8")
    for problem in problems_of_fields(document):
        field, _, why = problem.partition(": ")
        name = document["command"] + re.sub(r"\[[0-9]+\]", "[]", field)
        assert (why, f"`{name}`" in changelog) == ("not documented", True), problem
    assert document["schema"] == SCHEMAS["common.json"]["properties"]["schema"]["const"]


@all_rows("path", files("channels/*.json"), ids=name_of)
def test_channels_of_a_package_are_known(path: Path, tmp_path: Path) -> None:
    """As `soter.remote.connect` reads them; those of a later version are refused."""
    assert find_topics(path, None).all
    later = tmp_path / path.name
    shutil.copyfile(path, later)
    put("schema", 99)(later)
    with pytest.raises(soter.SoterError, match=r"X013.*build the package anew"):
        find_topics(later, None)


# ---------------------------------------------------------------- versions to come, and damage


def put(key: str, value: object) -> Callable[[Path], None]:
    """Another value in a JSON file."""

    def change(path: Path) -> None:
        document = json.loads(path.read_text(encoding="utf-8"))
        path.write_text(json.dumps({**document, key: value}), encoding="utf-8")

    return change


def of_a_later_format(folder: Path) -> None:
    """A certificate of a later version, sealed as it would be."""
    path = folder / "manifest.json"
    manifest = {**json.loads(path.read_text(encoding="utf-8")), "schema": 99}
    path.write_bytes(canonical_json(manifest))
    (folder / "SEAL").write_text(hashlib.sha256(canonical_json(manifest)).hexdigest() + "\n")


def of_a_later_edition(path: Path) -> None:
    """A program of a later edition."""
    path.write_text(path.read_text(encoding="utf-8").replace("soter 1;", "soter 2;"))


def with_a_later_key(path: Path) -> None:
    """A mapping with a word that is not known yet."""
    path.write_text("speed_of_light = 1.0\n" + path.read_text(encoding="utf-8"))


class Kind(NamedTuple):
    """A kind of file: where one lies, who reads it, what a later version of it would be.

    `exit`, `told`: what comes of that; `words`: the command line, `{}` being the file.
    """

    file: str
    words: str
    later: Callable[[Path], None]
    exit: int
    told: tuple[str, ...]


KINDS = (
    Kind(CART, "check {}", of_a_later_edition, 1, ("S002", "edition 1")),
    Kind(
        "certificates/small",
        "recheck {}",
        of_a_later_format,
        5,
        ("of a newer soter", "make it again with `soter verify --cert`"),
    ),
    Kind(
        "traces/late_sc-Late.trace.json",
        "replay {}",
        put("schema", 99),
        1,
        ("D010", "of a newer soter"),
    ),
    Kind(
        "campaigns/cart",
        "campaign RELEASE/programs/wall/cart.soter --flights 4 --until 5s -o {}",
        lambda folder: put("schema", 99)(folder / "campaign.json"),
        1,
        ("D006", "of a newer soter", "give another folder with -o"),
    ),
    Kind(
        "times/cart.json",
        "check RELEASE/programs/wall/cart.soter --times {}",
        put("schema", 99),
        2,
        ("U011", "of a newer soter", "soter measure"),
    ),
    Kind(
        "programs/mavlink/geofence.toml",
        "build RELEASE/programs/mavlink/geofence.soter --target mavlink --map {} -o out",
        with_a_later_key,
        1,
        ("D015", "speed_of_light"),
    ),
)
LAST = RELEASES[-1]


def copied(kind: Kind, folder: Path) -> Path:
    """A copy of the file, or of its folder, that the last release wrote."""
    source, copy = LAST / kind.file, folder / Path(kind.file).name
    (shutil.copytree if source.is_dir() else shutil.copyfile)(source, copy)
    return copy


def read(kind: Kind, path: Path, command: Callable[..., Ended]) -> Ended:
    """What the command of a kind makes of a file."""
    words = kind.words.replace("RELEASE", str(LAST)).replace("{}", str(path))
    return command(*words.split())


@all_rows("kind", KINDS, ids=lambda kind: kind.file)
def test_a_file_of_a_later_version_is_refused_in_words(
    kind: Kind, command: Callable[..., Ended], tmp_path: Path
) -> None:
    path = copied(kind, tmp_path)
    kind.later(path)
    ended = read(kind, path, command)
    assert ended.exit == kind.exit, ended.told
    assert [words for words in kind.told if words not in ended.told] == [], ended.told


def emptied(path: Path) -> None:
    """Nothing is left of it."""
    path.write_bytes(b"")


def cut(path: Path) -> None:
    """Its second half is lost."""
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])


def overwritten(path: Path) -> None:
    """Its middle is something else."""
    data = bytearray(path.read_bytes())
    data[len(data) // 3 : len(data) // 3 + 8] = b'\xff\x00{["=;\xfe'
    path.write_bytes(data)


@all_rows("damage", [emptied, cut, overwritten], ids=lambda damage: damage.__name__)
@all_rows("kind", KINDS, ids=lambda kind: kind.file)
def test_a_damaged_file_is_refused_with_a_code(
    kind: Kind, damage: Callable[[Path], None], command: Callable[..., Ended], tmp_path: Path
) -> None:
    """Neither taken for a whole one nor the end of the tool."""
    path = copied(kind, tmp_path)
    first = sorted(p for p in path.rglob("*.json") if p.parent == path) or [path]
    damage(first[0])
    ended = read(kind, path, command)
    assert ended.exit in (1, 2, 3, 5), ended.told
    assert ended.document["diagnostics"] or ended.exit in (3, 5), ended.told
