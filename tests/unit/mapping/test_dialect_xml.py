"""A stranger's dialect of MAVLink is data: nothing of it runs, and nothing leaves its folder.

Each wrong dialect would run code, be read from elsewhere or be written into C if pymavlink read it.
"""

from __future__ import annotations

import io
from contextlib import redirect_stdout
from pathlib import Path

import pytest

pytest.importorskip("pymavlink", reason="the extra `robots` is not installed")

from pymavlink.generator import mavparse

from soter.mapping.mavlink_dialects import (
    comment_text,
    dialect_path,
    dialect_xml,
    read_dialect,
    standard_dialects,
)
from soter.targets.mavlink_package import dialect_headers
from tables import all_rows

MESSAGE = '<message id="54000" name="{name}">{inside}</message>'
FIELD = '<field type="float" name="x" units="m">place</field>'
BEAT = '<message id="0" name="HEARTBEAT"><field type="uint8_t" name="type">t</field></message>'
TIME = '<message id="111" name="TIMESYNC"><field type="int64_t" name="tc1">t</field></message>'


def written(folder: Path, inside: str, before: str = "", name: str = "own.xml") -> Path:
    """A dialect with these messages."""
    at = folder / name
    at.write_text(f"<mavlink>{before}<messages>{inside}</messages></mavlink>")
    return at.resolve()


def message(inside: str = FIELD, name: str = "MY_PLACE", also: str = "") -> str:
    return MESSAGE.format(name=name, inside=inside + also)


RUNS = "__import__('pathlib').Path('ran').touch() or 7"


@pytest.mark.parametrize(
    "enums",
    [
        '<enums><enum name="E"><entry name="A" value="{}"/></enum></enums>',
        '<enums><enum name="E"><entry name="A"/><entry name="B" value="{}"/></enum></enums>',
        '<enums><enum name="MAV_CMD"><entry name="A" value="{}"/></enum></enums>',
    ],
)
def test_a_value_of_an_enum_is_not_evaluated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, enums: str
) -> None:
    monkeypatch.chdir(tmp_path)
    enum = enums.format(RUNS)
    written(tmp_path, BEAT + TIME, enum, "common.xml")
    at = written(tmp_path, message(), f"<include>common.xml</include>{enum}")
    dialect = read_dialect(at)
    assert {"MY_PLACE", "HEARTBEAT"} <= set(dialect.messages)
    assert dialect_headers(dialect, ["MY_PLACE"])
    assert not (tmp_path / "ran").exists()


def test_what_pymavlink_makes_of_the_same_file_runs_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So that the test above can fail."""
    monkeypatch.chdir(tmp_path)
    enum = f'<enums><enum name="E"><entry name="A" value="{RUNS}"/></enum></enums>'
    mavparse.MAVXML(str(written(tmp_path, message(), enum)), mavparse.PROTOCOL_2_0)
    assert (tmp_path / "ran").exists()


INCLUDES = ("../outside.xml", "{outside}", "sub/inner.xml", "..\\outside.xml", "linked.xml", "")


@pytest.mark.parametrize("include", INCLUDES)
def test_an_include_stays_in_its_folder(tmp_path: Path, include: str) -> None:
    outside = written(tmp_path, message(name="OUTSIDE"), name="outside.xml")
    folder = tmp_path / "log"
    (folder / "sub").mkdir(parents=True)
    written(folder / "sub", message(), name="inner.xml")
    (folder / "linked.xml").symlink_to(outside)
    name = include.format(outside=outside)
    written(folder, "", f"<include>{name}</include>", "middle.xml")
    at = written(folder, message(), "<include>middle.xml</include>")
    with pytest.raises(ValueError, match="no file beside it"):
        read_dialect(at)


ENTITY = '<!DOCTYPE mavlink [<!ENTITY a "{}">{}]>'
NESTED = "".join(f'<!ENTITY a{k + 1} "{f"&a{k};" * 10}">' for k in range(9))


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (
            ENTITY.format("x" * 100, '<!ENTITY a0 "lol">' + NESTED) + "<mavlink>&a9;</mavlink>",
            "type",
        ),
        ('<!DOCTYPE m SYSTEM "file:///etc/hostname"><mavlink/>', "document type"),
        ("<!DOCTYPE mavlink><mavlink/>", "document type"),
        ('<?xml version="1.0" encoding="martian"?><mavlink/>', "encoding"),
        ("<mavlink>" + "<a>" * 200_000, "no element|unclosed"),
        ("<mavlink>" + "<include>own.xml</include>" * 3 + "</mavlink>", "no messages"),
    ],
)
def test_a_document_that_grows_or_reads_elsewhere_is_refused(
    tmp_path: Path, text: str, why: str
) -> None:
    (tmp_path / "own.xml").write_text(text)
    with pytest.raises(ValueError, match=why):
        read_dialect((tmp_path / "own.xml").resolve())


def test_no_device_is_read_and_nothing_too_large(tmp_path: Path) -> None:
    (tmp_path / "own.xml").symlink_to("/dev/zero")
    with pytest.raises(OSError, match="no ordinary file"):
        dialect_xml(tmp_path / "own.xml")
    with (tmp_path / "large.xml").open("wb") as file:
        file.truncate(2**33)
    with pytest.raises(OSError, match="too large"):
        dialect_xml(tmp_path / "large.xml")
    for k in range(60):
        written(tmp_path, "", f"<include>d{k + 1}.xml</include>", f"d{k}.xml")
    with pytest.raises(ValueError, match="more than 50 files"):
        dialect_xml(tmp_path / "d0.xml")


@all_rows(
    "wrong",
    [
        message(name="A { int"),
        message(name="../../A"),
        message(name="A&#10;B"),
        message(f'<field type="float" name="x; int y">{FIELD}</field>'),
        message('<field type="float" name="$&#123;name}">x</field>'),
        message('<field type="float[__import__]" name="x">x</field>'),
        message('<field type="float[9999]" name="x">x</field>'),
        message('<field type="float" name="x" units="m */ int evil; /*">x</field>'),
        message('<field type="float" name="x" multiplier="9**9**9">x</field>'),
        message('<field type="float" name="x" invalid="$&#123;description}">x</field>'),
        message(also=FIELD),
        message() * 2,
        MESSAGE.format(name="A", inside=FIELD).replace("54000", "-1"),
        MESSAGE.format(name="A", inside=FIELD).replace("54000", "99999999"),
        MESSAGE.format(name="A", inside=FIELD).replace("54000", "0x10"),
        '<message name="A"/>',
    ],
)
def test_names_are_names_and_numbers_numbers(tmp_path: Path, wrong: str) -> None:
    with pytest.raises(ValueError, match=r"."):
        read_dialect(written(tmp_path, wrong))


@pytest.mark.parametrize(
    "evil",
    ["*/ int evil; /*", "*\\\n/ int evil;", "*??/\n/ int evil;", "${description} ${{fields:x}}"],
)
def test_words_stay_in_their_comment(tmp_path: Path, evil: str) -> None:
    """What is left of the C when its comments are taken out does not depend on the words."""

    def code(words: str) -> list[str]:
        told = f'<field type="float" name="x" print_format="{words}">{words}</field>'
        inside = message(f"<description>{words}</description>{told}")
        headers = dialect_headers(
            read_dialect(written(tmp_path, BEAT + TIME + inside)), ["MY_PLACE"]
        )
        read_dialect.cache_clear()
        text = next(f.text for f in headers if f.path.endswith("my_place.h"))
        return [part.partition("/*")[0] for part in text.split("*/")]

    assert code(evil) == code("place")
    assert comment_text("a*/b") == "a /b"


def test_the_name_of_the_file_stays_in_its_comment(tmp_path: Path) -> None:
    at = written(tmp_path, BEAT + TIME, name="x*\\ int evil;.xml")
    text = dialect_headers(read_dialect(at), [])[-1].text
    assert text.startswith("/* soter_mavlink_dialect.h: dialect x  int evil; of MAVLink 2")


@pytest.mark.parametrize("name", [standard_dialects()[0], "minimal"])
def test_what_pymavlink_brings_is_read_as_pymavlink_reads_it(name: str) -> None:
    """Lengths and checksums of every message are those of its own parser, file by file."""
    dialect = read_dialect(dialect_path(name, Path()).resolve())
    known = {c.id: c for c in dialect.checksums}

    def files(at: Path) -> list[mavparse.MAVXML]:
        with redirect_stdout(io.StringIO()):
            xml = mavparse.MAVXML(str(at), mavparse.PROTOCOL_2_0)
        return [xml] + [x for i in xml.include for x in files(at.parent / i)]

    theirs = {m.id: m for x in files(dialect_path(name, Path())) for m in x.message}
    assert set(known) == set(theirs)
    for number, m in theirs.items():
        ours = dialect.messages[m.name]
        assert ours.fields_in_order == tuple(f.name for f in m.fields)
        assert (known[number].extra, known[number].longest, known[number].shortest) == (
            *(m.crc_extra, m.wire_length, m.wire_min_length),
        )
        assert ours.invalid == {f.name: f.invalid for f in m.fields if f.invalid}


def test_an_include_of_a_link_lies_beside_the_link(tmp_path: Path) -> None:
    """As named; where both are links to one other folder, what they lead to is read."""
    for folder in ("kept", "used", "both"):
        (tmp_path / folder).mkdir()
    kept = written(tmp_path / "kept", message(name="OWN"), "<include>inner.xml</include>")
    written(tmp_path / "kept", message(name="KEPT").replace("54000", "54001"), name="inner.xml")
    written(tmp_path / "used", message(name="USED").replace("54000", "54001"), name="inner.xml")
    for folder in ("used", "both"):
        (tmp_path / folder / "own.xml").symlink_to(kept)
    (tmp_path / "both" / "inner.xml").symlink_to(tmp_path / "kept" / "inner.xml")
    for folder, name in (("used", b"USED"), ("both", b"KEPT")):
        assert b'"%s"' % name in dialect_xml(tmp_path / folder / "own.xml")
