"""A campaign goes on only where what flies is what flew: program, data, externs, Soter itself.

Each kind of change is seen by the folder; where nothing was changed the flights are taken.
"""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING

import pytest

from soter import SoterError, load
from soter.api.assurance.evidence import read_flights, replay_flights
from soter.campaign import batch_flights
from soter.campaign.batch_flights import Fleet
from soter.native.cache import SOTER, has_macro_includes
from soter.native.shared_library import c_texts, library_flags

if TYPE_CHECKING:
    from pathlib import Path

    from soter.campaign.result import Campaign

PROGRAM = """soter 1;
topic y: float in [-40.0, 40.0] max_age 100ms;
topic u: float in [-1.0, 1.0] = 0.0;
extern fun moved(s: float, push: float): float from "c:{c}:moved";
plant Body period 10ms {{
  reads u;
  drives y = s;
  state s: float in [-0.5, 0.5];
  next s = moved(s, u);
}}
const BIAS: float = {bias};
node Calm period 20ms {{
  subscribes y; publishes u;
  step {{ publish u = clamp(BIAS - y, -1.0, 1.0); }}
}}
system Whole {{ body: Body; node Calm; until 1s; always abs(body.truth.s) < 3.0; {faults} }}
"""
BODY = '#include "body.h"\n{more}\ndouble moved(double s, double push) {{ return {value}; }}\n'
HEADER = "#include <stdint.h>\n#define GAIN {}\n"
WHAT = "s + 0.01 * GAIN * push"


def write(folder: Path, more: str = "", value: str = WHAT, faults: str = "") -> Path:
    """The program, whose C is two headers deep in another folder."""
    (folder / "c" / "inc").mkdir(parents=True)
    (folder / "c" / "body.c").write_text(BODY.format(more=more, value=value))
    (folder / "c" / "body.h").write_text('#include "inc/gain.h"\n')
    (folder / "c" / "inc" / "gain.h").write_text(HEADER.format(0.5))
    file = folder / "p.soter"
    file.write_text(PROGRAM.format(c="c/body.c", bias=0.1, faults=faults))
    return file


def flown(file: Path, flights: int = 2, moved: str | None = None) -> Campaign:
    program = load(file)
    if moved is not None:
        program = program.bind("moved", moved)
    return program.campaign("Whole", flights=flights, workers=1, output=file.parent / "flown")


def refused(file: Path, moved: str | None = None) -> str:
    before = (file.parent / "flown" / "flights.csv").read_bytes()
    with pytest.raises(SoterError) as caught:
        flown(file, moved=moved)
    assert [d.code for d in caught.value.diagnostics] == ["D006"]
    assert (file.parent / "flown" / "flights.csv").read_bytes() == before
    return caught.value.diagnostics[0].message


def test_what_is_the_same_is_taken(tmp_path: Path) -> None:
    file = write(tmp_path / "a")
    first = flown(file)
    assert (first.flown, flown(file).flown, flown(file, 3).flown) == (2, 0, 1)
    moved = tmp_path / "b"
    shutil.copytree(file.parent, moved)
    assert flown(moved / file.name, 4).flown == 1


CHANGES = {
    "c": ("c/body.c", "0.01 * GAIN", "0.04 * GAIN"),
    "header": ("c/body.h", "inc/gain.h", "inc/../inc/gain.h"),
    "header of a header": ("c/inc/gain.h", "0.5", "2.0"),
    "program": ("p.soter", "0.1", "0.2"),
    "faults": ("p.soter", "until 1s;", "until 1s; faults { skip Calm at 900 per 1h for 40ms; }"),
}


@pytest.mark.parametrize("kind", CHANGES)
def test_what_is_another_is_not(kind: str, tmp_path: Path) -> None:
    file = write(tmp_path / "a")
    flown(file)
    name, old, new = CHANGES[kind]
    text = (file.parent / name).read_text()
    assert old in text
    (file.parent / name).write_text(text.replace(old, new))
    assert ("the C of an extern" if name != file.name else "the program") in refused(file)
    (file.parent / name).write_text(text)
    assert flown(file).flown == 0


@pytest.mark.parametrize(
    "include", ['#define H "more.h"\n#include H', '#include \\\n "more.h"', '%:include "more.h"']
)
def test_a_header_is_seen_however_it_is_included(include: str, tmp_path: Path) -> None:
    file = write(tmp_path / "a", include, "MORE * push")
    (file.parent / "c" / "more.h").write_text("#define MORE 0.5\n")
    digest = flown(file).result.digest
    (file.parent / "c" / "more.h").write_text("#define MORE 2.0\n")
    assert "the C of an extern" in refused(file)
    shutil.rmtree(file.parent / "flown")
    assert flown(file).result.digest != digest  # and nothing that was compiled of the old one


def test_a_header_whose_name_a_macro_makes_is_compiled_anew(tmp_path: Path) -> None:
    made = "#define STR(x) #x\n#include STR(more.h)"
    file = write(tmp_path / "a", made, "MORE * push")
    (file.parent / "c" / "more.h").write_text("#define MORE 0.5\n")
    digest = flown(file).result.digest
    (file.parent / "c" / "more.h").write_text("#define MORE 2.0\n")
    shutil.rmtree(file.parent / "flown")
    assert flown(file).result.digest != digest


@pytest.mark.parametrize(
    ("text", "computes"),
    [
        ("#define STR(x) #x\n#include STR(more.h)", True),
        ("#define STR(x) #x\n#define H STR(more.h)\n#include H", True),
        ("%:include \\\n STR(more.h)", True),
        ("#include GIVEN_ELSEWHERE", True),
        ('#define H "more.h"\n#ifdef X\n#define H STR(other.h)\n#endif\n#include H', True),
        ('#define H "more.h"\n#include H', False),
        ("#define H <math.h>\n#include H", False),
        ('#include "more.h"\n#include <math.h>\n#define STR(x) #x', False),
    ],
)
def test_what_no_key_is_of(text: str, computes: bool) -> None:
    assert has_macro_includes([text]) == computes


def test_the_c_of_soter_has_a_key() -> None:
    """Or nothing of it would be kept."""
    of_soter = [p for p in SOTER.rglob("*.[ch]") if "ros" not in p.parts]
    assert c_texts(*of_soter) == c_texts(*of_soter)


def test_another_file_that_is_bound(tmp_path: Path) -> None:
    file = write(tmp_path / "a")
    for name, value in (("one.c", "s"), ("two.c", "s + push")):
        text = BODY.format(more="", value=value)
        (file.parent / "c" / name).write_text(text)
    at = f"c:{file.parent}/c"
    flown(file, moved=f"{at}/one.c:moved")
    assert "the C of an extern" in refused(file, moved=f"{at}/two.c:moved")
    assert flown(file, moved=f"{at}/one.c:moved").flown == 0


UNKNOWN = {
    "file": ("#include <stdio.h>", '(fopen("gain.txt", "r") ? 1.0 : 0.5)', "`fopen`"),
    "environment": ("#include <stdlib.h>", '(getenv("GAIN") ? 1.0 : 0.5)', "`getenv`"),
    "clock": ("#include <time.h>", "(double)time(0)", "`time`"),
    "header": (
        "#define S(x) #x\n#define T(x) S(x)\n#include T(more.h)",
        "MORE",
        "it includes `more.h`",
    ),
}


@pytest.mark.parametrize("kind", UNKNOWN)
def test_what_cannot_be_known_is_not_taken(kind: str, tmp_path: Path) -> None:
    more, value, why = UNKNOWN[kind]
    file = write(tmp_path / "a", more, f"0.0 * {value} + s")
    (file.parent / "c" / "more.h").write_text("#define MORE 0.5\n")
    flown(file)
    said = refused(file)
    assert "2 flights cannot be taken" in said
    assert why in said


def test_memory_of_its_own_is_known(tmp_path: Path) -> None:
    more = "#include <stdlib.h>\n#include <string.h>\nstatic double kept;"
    file = write(tmp_path / "a", more, "(kept += *(double *)calloc(1, 8)) + s")
    flown(file)
    assert flown(file, 3).flown == 1


def test_the_compiler_of_an_extern_counts_and_so_does_the_c_of_soter(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = write(tmp_path / "a")
    flown(file)
    with monkeypatch.context() as patched:
        patched.setattr(batch_flights, "library_flags", lambda o: (*library_flags(o), "-DOTHER"))
        assert "or its compiler" in refused(file)
    with monkeypatch.context() as patched:
        patched.setattr(batch_flights, "c_texts", lambda *s: [*c_texts(*s), "changed"])
        assert "another version of Soter" in refused(file)
    assert flown(file).flown == 0


def test_data_of_a_program_is_part_of_it(tmp_path: Path) -> None:
    file = write(tmp_path / "a")
    text = file.read_text().replace("float = 0.1", 'float[2] = data "bias.csv"')
    file.write_text(text.replace("BIAS -", "BIAS[1] -"))
    (file.parent / "bias.csv").write_text("0.0\n0.1\n")
    flown(file)
    (file.parent / "bias.csv").write_text("0.0\n0.2\n")
    assert "the program (its text, or a file that it reads)" in refused(file)


def test_an_extern_in_c_is_asked_for_by_every_fleet(tmp_path: Path) -> None:
    flat = load(write(tmp_path / "a")).flat("Whole")
    code = Fleet(flat, 10**9).code_fields()
    assert sorted(code["linked"]) == ["body.c", "body.h", "compiler", "gain.h"]
    assert code["unknown"] == ""


def test_flights_of_another_extern_are_no_evidence(tmp_path: Path) -> None:
    file = write(tmp_path / "a")
    folder = flown(file).folder
    flat = load(file).flat("Whole")

    def why() -> str:
        return replay_flights(load(file), flat, {}, read_flights(folder), 1).why

    assert why() == ""
    (file.parent / "c" / "inc" / "gain.h").write_text(HEADER.format("0.5 * (1 + 0)"))
    assert "the C of externs that the campaign flew is another now" in why()
