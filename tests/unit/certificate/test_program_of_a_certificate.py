"""The program of a certificate: all its files, its parameters, and values as they are written."""

from __future__ import annotations

import json
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest

from soter.certificate.reading import folder as certificate_program
from soter.certificate.reading.folder import (
    Certificate,
)
from soter.certificate.report import NotRecheckedError, RejectedError
from soter.diagnostics.diagnostic import SoterError
from soter.language.front_end import check_file
from soter.language.model.types import BoolType, DurationType, EnumType, FloatType, IntType
from tables import all_rows

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

PROGRAM = """soter 1;
{imported}param speed: float = 1.0 in [0.0, 2.0];
topic x: float max_age 20ms;
topic u: float in [-1.0, 1.0];
plant P period 10ms {{ reads u; drives x = p; state p: float; der p = speed * u; }}
node Go period 20ms {{ publishes u; step {{ publish u = 1.0; }} }}
system S {{ p: P; g: Go; }}
"""


def certificate_of(folder: Path, params: object, **more: Any) -> Certificate:
    """A certificate of the program above, in its folder."""
    program = folder / "program"
    program.mkdir(exist_ok=True)
    (program / "main.soter").write_text(PROGRAM.format(imported=more.pop("imported", "")))
    for name, text in more.pop("files", {}).items():
        (program / name).parent.mkdir(parents=True, exist_ok=True)
        (program / name).write_text(text)
    checked = check_file(str(program / "main.soter"), None, more.pop("values", {}))
    assert checked.program is not None
    digest = checked.program.sha256
    manifest = {"main": "main.soter", "params": params, "program_sha256": digest, **more}
    contents = {
        f"program/{p.relative_to(program).as_posix()}": p.read_bytes()
        for p in program.rglob("*")
        if p.is_file()
    }
    return Certificate(folder, manifest, contents, set())


GONE = "rta M {{ ac module K; sc Go; period 20ms; safe x < 1.0; verify {{ {} }} }}"


@pytest.mark.parametrize("verify", ["", "polytope x in [0.0, 1.0];"])
@pytest.mark.parametrize("wrong_besides", ["", "node Go period 20ms { }"])
def test_a_program_of_an_older_soter_is_no_false_one(
    verify: str, wrong_besides: str, tmp_path: Path
) -> None:
    certificate = certificate_of(tmp_path, {})
    main = tmp_path / "program" / "main.soter"
    main.write_text(f"{PROGRAM.format(imported='')}{GONE.format(verify)}{wrong_besides}")
    certificate.contents["program/main.soter"] = main.read_bytes()
    with pytest.raises(SoterError if wrong_besides else NotRecheckedError, match="S026"):
        certificate_program.read_program(certificate)


def test_a_program_is_read_with_its_parameters(tmp_path: Path) -> None:
    for params, values in (({}, {}), ({"speed": (1.5).hex()}, {"speed": 1.5})):
        certificate = certificate_of(tmp_path, params, values=values)
        checked, overrides = certificate_program.read_program(certificate)
        assert overrides == values
        assert checked.program is not None
        assert checked.ok


@pytest.mark.parametrize("main", [None, 3, "other.soter", "../main.soter", ""])
def test_a_main_file_that_is_not_there(tmp_path: Path, main: object) -> None:
    with pytest.raises(RejectedError, match="main file"):
        certificate_program.read_program(certificate_of(tmp_path, {}, main=main))


@pytest.mark.parametrize("params", [None, [], "speed", {"other": (1.0).hex()}, {"speed": 1.0}])
def test_parameters_that_are_none(tmp_path: Path, params: object) -> None:
    with pytest.raises(RejectedError, match=r"params|parameter|hexadecimal"):
        certificate_program.read_program(certificate_of(tmp_path, params))


def test_a_program_is_the_one_that_the_manifest_says(tmp_path: Path) -> None:
    with pytest.raises(RejectedError, match="another one"):
        certificate_program.read_program(certificate_of(tmp_path, {}, program_sha256="0" * 64))


def test_a_program_with_errors_is_none(tmp_path: Path) -> None:
    certificate = certificate_of(tmp_path, {})
    path = tmp_path / "program/main.soter"
    for text in ("soter 1; system", "soter 1; topic x: nothing;", ""):
        path.write_text(text)
        with pytest.raises(SoterError):
            certificate_program.read_program(certificate)


def test_every_file_below_the_program_is_read(tmp_path: Path) -> None:
    files = {"more.soter": "soter 1;\n"}
    imported = 'import "more.soter" as more;\n'
    certificate_program.read_program(certificate_of(tmp_path, {}, files=files, imported=imported))
    with pytest.raises(RejectedError, match=r"does not read `program/more\.soter`"):
        certificate_program.read_program(certificate_of(tmp_path, {}, files=files))


@pytest.mark.parametrize("inside", [True, False])
def test_what_is_read_lies_in_the_certificate(tmp_path: Path, inside: bool) -> None:
    folder = tmp_path / "certificate"
    folder.mkdir()
    (tmp_path / "more.soter").write_text("soter 1;\n")
    if inside:  # below the folder, and not one of its files
        (folder / "program").mkdir()
        (folder / "program/more.soter").write_text("soter 1;\n")
    imported = f'import "{"" if inside else "../../"}more.soter" as more;\n'
    certificate = certificate_of(folder, {}, imported=imported)
    certificate.contents.pop("program/more.soter", None)
    with pytest.raises(RejectedError, match="outside the certificate"):
        certificate_program.read_program(certificate)


@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"])
def test_what_was_checked_is_what_is_sealed(tmp_path: Path, mark: bytes) -> None:
    certificate = certificate_of(tmp_path, {})
    checked = check_file(str(tmp_path / "program/main.soter"))
    (name,) = certificate.contents
    certificate.contents[name] = mark + certificate.contents[name]
    certificate_program._refuse_bytes_not_sealed(certificate, checked)
    certificate.contents[name] += b" "
    with pytest.raises(RejectedError, match="while it was being read"):
        certificate_program._refuse_bytes_not_sealed(certificate, checked)


@pytest.mark.parametrize(
    "text",
    [1.0, None, "1.0", "0x1p0", "0x1.0000000000000p+00", "inf", "nan", "-inf", "", "0x1p9999"],
)
def test_a_number_that_is_not_written_in_the_one_way(text: object) -> None:
    with pytest.raises(RejectedError, match=r"hexadecimal|not written"):
        certificate_program.number_from_hexadecimal(text, "x")


def test_a_number_is_written_in_one_way() -> None:
    for value in (0.0, -0.0, 1.5, -2.75e-300, 5e-324, 1.7e308):
        found = certificate_program.number_from_hexadecimal(value.hex(), "x")
        assert json.dumps(found) == json.dumps(value)


def kinds() -> list[tuple[object, object, bool]]:
    """Types, values of them, and whether they are some."""
    whole: Callable[..., Any] = SimpleNamespace
    of: Any = {t: t.__new__(t) for t in (BoolType, IntType, DurationType, EnumType)}
    object.__setattr__(of[EnumType], "members", ("A", "B"))
    rows: list[tuple[object, object, bool]] = [(whole(), 1, False)]
    for t, right in ((BoolType, True), (IntType, 7), (DurationType, 9)):
        rows += [(of[t], right, True), (of[t], "1", False), (of[t], 1.0, False)]
    rows += [(of[BoolType], 1, False), (of[IntType], True, False), (of[IntType], -3, True)]
    rows += [(of[EnumType], k, 0 <= k < 2) for k in (-1, 0, 1, 2)]
    rows += [(FloatType.__new__(FloatType), 1.0, False)]
    return rows


@all_rows(("of", "value", "fine"), kinds())
def test_a_value_is_one_of_its_type(of: object, value: object, fine: bool) -> None:
    if fine:
        assert certificate_program._parameter_value(of, value, "x") is value
    else:
        with pytest.raises(RejectedError):
            certificate_program._parameter_value(of, value, "x")
