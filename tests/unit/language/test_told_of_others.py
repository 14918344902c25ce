"""Of a file that a program only names, and that is none, not a word is told: it may be anybody's.

A robot's repository, or a build of a stranger's change, would otherwise show what a file holds that
only its owner may read.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest

from soter.cli.main import main

if TYPE_CHECKING:
    from pathlib import Path

SECRET = "not-for-strangers-7c1f"  # noqa: S105 - a mark
HEAD = (
    "soter 1;\ntopic u: float = 0.0;\nnode N period 10ms { publishes u; step { publish u = A; } }\n"
)
SYSTEM = "system S default { node N; until 20ms; }\n"
KINDS = {
    "import": ('import "{}" as other;\nconst A: float = 0.5;\n', "key"),
    "import, behind comments": ('import "{}" as other;\nconst A: float = 0.5;\n', "notes"),
    "json": ('const A: float = data "{}";\n', "one.json"),
    "json that is none": ('const A: float = data "{}";\n', "words.json"),
    "csv": ('const B: int[2] = data "{}";\nconst A: float = float(B[0]);\n', "cells.csv"),
    "another kind": ('const A: float = data "{}";\n', "key"),
}
FILES = {
    "key": f"{SECRET}:x:0:0\n",
    "notes": f"// a comment\n\n{SECRET} = 1\n",
    "one.json": json.dumps({SECRET: 1}),
    "words.json": SECRET,
    "cells.csv": f"{SECRET}\n{SECRET}\n",
}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "sent").mkdir()
    (tmp_path / "outside").mkdir()
    for name, text in FILES.items():
        (tmp_path / "outside" / name).write_text(text)
    monkeypatch.chdir(tmp_path / "sent")
    return tmp_path / "sent"


@pytest.mark.parametrize("way", ["above", "absolute", "a link"])
@pytest.mark.parametrize("kind", KINDS)
def test_words_of_a_file_elsewhere_are_not_told(
    folder: Path, capfd: pytest.CaptureFixture[str], kind: str, way: str
) -> None:
    text, name = KINDS[kind]
    there = folder.parent / "outside" / name
    (folder / name).symlink_to(there)
    named = {"above": f"../outside/{name}", "absolute": str(there), "a link": name}[way]
    (folder / "p.soter").write_text(HEAD + text.format(named) + SYSTEM)
    for form in ((), ("--json",), ("--format", "sarif")):
        assert main(["check", "p.soter", *form]) == 1
        said = "".join(capfd.readouterr())
        assert SECRET not in said
        assert name in said


def test_words_of_a_file_beside_the_program_are(
    folder: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Also where both are links to another folder, as a build leaves them."""
    kept = folder.parent / "kept"
    kept.mkdir()
    (kept / "one.json").write_text(FILES["one.json"])
    (kept / "p.soter").write_text(HEAD + KINDS["json"][0].format("one.json") + SYSTEM)
    for name in ("p.soter", "one.json"):
        (folder / name).symlink_to(kept / name)
    for program in ("p.soter", "../kept/p.soter"):
        assert main(["check", program]) == 1
        assert SECRET in "".join(capfd.readouterr())


def test_an_import_elsewhere_that_is_a_program_is_checked_as_any(
    folder: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (folder.parent / "lib.soter").write_text("// ours\nsoter 1;\nconst B: float = ;\n")
    text = KINDS["import"][0].format("../lib.soter")
    (folder / "p.soter").write_text(HEAD + text + SYSTEM)
    assert main(["check", "p.soter"]) == 1
    assert "const B: float = ;" in "".join(capfd.readouterr())


def test_the_program_of_a_trace_is_no_other_file(
    folder: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """A trace, or a counterexample, names a program; what is none belongs to no trace."""
    counts = "state k: int in [0, 9] = 0; next k = min(9, k + 1);"
    plant = f"plant P period 10ms {{ drives n = k; {counts} }}"
    (folder / "p.soter").write_text(
        f"soter 1;\ntopic n: int in [0, 9] = 0;\n{plant}\n"
        "system S default { p: P; until 50ms; always n < 3; }\n"
        "test T { system S; horizon 50ms; }\n"
    )
    assert main(["test", "p.soter"]) == 3
    (trace,) = (folder / ".soter").glob("*.trace.json")
    document = json.loads(trace.read_text())
    document["program"] = "../../outside/key"
    trace.write_text(json.dumps(document))
    capfd.readouterr()
    assert main(["replay", str(trace)]) == 1
    said = "".join(capfd.readouterr())
    assert "D011" in said
    assert SECRET not in said


def test_the_program_of_a_counterexample_neither(
    folder: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (folder / "c.json").write_text(
        json.dumps(
            {
                "schema": 1,
                "kind": "counterexample",
                "program": "../outside/key",
                "program_sha256": "0",
                "system": "S",
            }
        )
    )
    assert main(["replay", "c.json"]) == 1
    assert SECRET not in "".join(capfd.readouterr())


def test_words_of_what_is_no_message_definition_are_not_told(
    folder: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    topics = '[topics.u]\ntype = "own/Place"\nchannel = "/u"\n[topics.u.fields]\nvalue = "x"\n'
    (folder / "p.soter").write_text(HEAD + "const A: float = 0.5;\n" + SYSTEM)
    (folder / "log.csv").write_text("t,u\n0.0,0.0\n")
    for name in ("key", "notes", "words.json"):
        (folder / "map.toml").write_text(f'[messages]\n"own/Place" = "../outside/{name}"\n{topics}')
        assert main(["monitor", "p.soter", "log.csv", "--map", "map.toml"]) == 1
        assert SECRET not in "".join(capfd.readouterr())
