"""Trace files: written, read back the same, and refused with a reason where they are damaged."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest

from generators.damaged_json import MISSING, damaged
from soter.diagnostics.diagnostic import SoterError
from soter.explore.trace import (
    BYTES_MAX,
    program_path,
    read_document,
    trace_document,
    trace_from_document,
    write_trace,
)
from unit.explore.explored_programs import TESTED
from unit.explore.random_walks import system_of_text, walk

if TYPE_CHECKING:
    from pathlib import Path

    from soter.explore.trace import Trace


@pytest.fixture(scope="module")
def trace() -> Trace:
    return walk(system_of_text(TESTED, "Skips"), 3).trace


def read_trace(path: Path) -> Trace:
    return trace_from_document(read_document(path), path)


def test_what_is_written_is_read_back(trace: Trace, tmp_path: Path) -> None:
    told = replace(trace, program=str(tmp_path / "small.soter"), params={"GAIN": 2, "T": "Ü\u0000"})
    path = write_trace(told, tmp_path / "folder" / "a.trace.json")
    loaded_trace = read_trace(path)
    assert loaded_trace.program == "../small.soter"
    assert replace(loaded_trace, program=told.program) == told
    assert len(path.read_text("utf-8").splitlines()) < len(trace.steps) + 40, "a line a step"


def test_a_trace_without_steps_is_written_too(trace: Trace, tmp_path: Path) -> None:
    path = write_trace(replace(trace, steps=()), tmp_path / "a.trace.json")
    assert read_trace(path).steps == ()


def test_the_program_lies_beside_the_trace_or_where_it_was_given(
    trace: Trace, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "robot").mkdir()
    program = tmp_path / "robot" / "p.soter"
    program.write_text("soter 1;")
    path = write_trace(replace(trace, program=str(program)), tmp_path / "robot" / "x" / "t.json")
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert program_path(read_trace(path)) == str(program)
    document = json.loads(path.read_text())
    path.write_text(json.dumps({**document, "program": "here.soter"}))
    (tmp_path / "elsewhere" / "here.soter").write_text("soter 1;")
    assert program_path(read_trace(path)) == "here.soter"


def test_a_folder_that_cannot_be_written_is_said(trace: Trace, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(SoterError) as error:
        write_trace(trace, tmp_path / "file" / "a.trace.json")
    assert error.value.diagnostics[0].code == "D006"


# ---------------------------------------------------------------- damaged ones


def reason(path: Path) -> str:
    with pytest.raises(SoterError) as error:
        read_trace(path)
    (problem,) = error.value.diagnostics
    assert problem.code == "D010"
    return problem.message


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no JSON"),
        ("{", "no JSON"),
        ("\ufeff\u0000", "no JSON"),
        ("[1, 2]", "no JSON object"),
        ("null", "no JSON object"),
        ("[" * 100_000, "nested too deeply"),
        ('{"schema": ' + "9" * 5000 + "}", "no JSON"),
        ('{"kind": "something else", "schema": 1}', "`kind`"),
        ('{"kind": "soter trace", "schema": 2}', "of a newer soter"),
        ('{"kind": "soter trace", "schema": 1}', "`property` is missing"),
    ],
)
def test_what_is_no_trace_is_told_so(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "a.json"
    path.write_text(text)
    assert said in reason(path)


def test_what_is_no_file_is_told_so(tmp_path: Path) -> None:
    assert "it is a folder" in reason(tmp_path)
    assert "no such file" in reason(tmp_path / "none.json")
    (tmp_path / "bytes").write_bytes(b"\xff\xfe\x00\x80")
    assert "no JSON" in reason(tmp_path / "bytes")
    with (tmp_path / "large").open("wb") as stream:
        stream.truncate(BYTES_MAX + 1)
    assert "too large" in reason(tmp_path / "large")


HUGE = 10**40
WRONG: tuple[object, ...] = (None, True, -1.5, HUGE, -HUGE, "x", [], {}, [[]], {"a": 1}, 1e308)


def test_no_field_of_a_wrong_kind_gets_past(trace: Trace, tmp_path: Path) -> None:
    """Anything in any place: a trace, or D010; never something else."""
    with_choices = [s for s in trace.steps if s.choices]
    document = trace_document(replace(trace, steps=tuple(with_choices[:1])))
    path, refused = tmp_path / "a.json", 0
    for _, _, changed in damaged(document, (*WRONG, MISSING)):
        path.write_text(json.dumps(changed))
        try:
            loaded_trace = read_trace(path)
        except SoterError as error:
            refused += 1
            assert [d.code for d in error.diagnostics] == ["D010"]  # noqa: PT017
        else:
            assert all(isinstance(s.time_ns, int) for s in loaded_trace.steps)
            assert all(0 <= c.pick < c.of for s in loaded_trace.steps for c in s.choices)
    assert refused > 150


def test_a_pick_beyond_its_alternatives_is_refused(trace: Trace, tmp_path: Path) -> None:
    document: Any = trace_document(trace)
    step = next(s for s in document["steps"] if s["choices"])
    step["choices"][0]["pick"] = step["choices"][0]["of"]
    (tmp_path / "a.json").write_text(json.dumps(document))
    assert "count from 0" in reason(tmp_path / "a.json")
