"""Checkpoints: what is refused, what may differ, and that damage is never gone on from."""

from __future__ import annotations

import hashlib
import json
import os
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import processes
import soter
from generators.interrupted_searches import chance
from generators.long_search_programs import wanderers
from soter.explore import checkpoints
from soter.explore.checkpoints import HEAD, MAGIC, read_checkpoint

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.explore.search_options import SearchProgress

LONG = wanderers(1000, extra="overrun N by 10ms; skip A at most 1;")
"""Of millions of configurations."""
ENDLESS = wanderers(1000, most=4000, extra="overrun N by 10ms;")
for bound, further in (("[-9, 9]", "[-2000, 2000]"), ("= 8", "= 1999"), ("-8", "-1999")):
    ENDLESS = ENDLESS.replace(bound, further)
"""Of more than any machine searches before it is interrupted."""


@pytest.fixture
def program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> soter.Program:
    (tmp_path / "w.soter").write_text(wanderers(110, extra="overrun N by 10ms;"))
    monkeypatch.chdir(tmp_path)
    return soter.load("w.soter")


def begun(program: soter.Program, **more: Any) -> Path:
    """A checkpoint of a search that is not at its end."""
    how: dict[str, Any] = {"reduction": "none", "max_states": 9_000, "checkpoint": "save"}
    how |= {"output": None, **more}
    report = program.explore(**how)
    (test,) = report.tests
    assert (test.bound, test.checkpoint is not None) == ("states", True)
    assert test.checkpoint is not None
    assert test.checkpoint.states == test.states
    assert not test.checkpoint.problem
    return test.checkpoint.path


def code_of(do: Callable[[], object]) -> tuple[str, str]:
    """Code and text of the first diagnostic that is raised."""
    with pytest.raises(soter.SoterError) as error:
        do()
    first = error.value.diagnostics[0]
    return first.code, " ".join((first.message, *first.notes, *first.helps))


def resumed(**more: Any) -> Any:
    """The report of going on."""
    how: dict[str, Any] = {"reduction": "none", "output": None, "resume": "save"} | more
    return soter.load("w.soter").explore(**how)


def test_it_goes_on_with_more_of_everything(program: soter.Program) -> None:
    path = begun(program)
    assert [p.name for p in path.parent.iterdir()] == ["T.checkpoint"]
    (whole,) = program.explore(reduction="none", output=None).tests
    (test,) = resumed(memory="3G", threads=3, minimise=1.0, time=500).tests
    assert (test.verdict, test.states, test.depth) == ("exhausted", whole.states, whole.depth)
    assert test.coverage == whole.coverage
    assert test.checkpoint.resumed >= 9_000
    (again,) = resumed().tests
    assert (again.verdict, again.states, again.depth) == ("exhausted", whole.states, whole.depth)
    assert again.covered_ns == whole.covered_ns
    assert again.checkpoint.resumed == whole.states


def test_a_test_without_a_checkpoint_begins(tmp_path: Path) -> None:
    text = wanderers(110, extra="overrun N by 10ms;")
    two = text + text[text.index("test T") :].replace("test T", "test Other")
    (tmp_path / "w.soter").write_text(two)
    both = soter.load(tmp_path / "w.soter")
    (alone,) = both.explore("T", output=None, checkpoint=tmp_path, max_states=500).tests
    assert alone.bound == "states"
    first, second = both.explore(output=None, resume=tmp_path).tests
    assert (first.states, first.verdict) == (second.states, "exhausted")
    assert first.checkpoint is not None
    assert second.checkpoint is not None
    assert (first.checkpoint.resumed, second.checkpoint.resumed) == (alone.states, 0)


def test_where_nothing_can_be_written_it_is_told(tmp_path: Path) -> None:
    """It ended among its first configurations."""
    states = "".join(f"state a{i}: float in [-1.0, 1.0]; next a{i} = 0.0;" for i in range(40))
    (tmp_path / "b.soter").write_text(
        f"""soter 1; topic pos: float; plant Point period 10ms {{ drives pos = a0; {states} }}
        system S {{ p: Point; until 100ms; }}
        test T {{ system S; horizon 20ms; always pos <= 2.0; }}"""
    )
    (test,) = (
        soter.load(tmp_path / "b.soter")
        .explore(output=None, checkpoint=tmp_path / "save", max_states=1000)
        .tests
    )
    assert test.bound in {"states", "memory"}
    assert test.checkpoint is not None
    assert (test.checkpoint.states, test.checkpoint.problem) == (0, checkpoints.UNWRITTEN)


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ({"reduction": "all"}, "the reduction: none then, all now"),
        ({"storage": "fingerprint"}, "the storage: exact then, fingerprint now"),
        ({"horizon": "100ms"}, "the horizon: 110 ms then, 100 ms now"),
        ({"skew": "10ms"}, "the skew: 0 s then, 10 ms now"),
        ({"seed": 2}, "the seed: 1 then, 2 now"),
    ],
)
def test_another_search_does_not_go_on_from_it(
    how: dict[str, Any], said: str, program: soter.Program
) -> None:
    path = begun(program)
    before = path.read_bytes()
    code, text = code_of(lambda: resumed(**how))
    assert code == "D013"
    assert said in text
    assert path.read_bytes() == before


def test_another_program_does_not_go_on_from_it(program: soter.Program, tmp_path: Path) -> None:
    begun(program)
    (tmp_path / "w.soter").write_text(wanderers(110, extra="overrun N by 10ms;") + "// another\n")
    code, text = code_of(resumed)
    assert code == "D013"
    assert "the program: " in text


def test_what_is_there_is_not_written_over(program: soter.Program) -> None:
    path = begun(program)
    before = path.read_bytes()
    assert code_of(lambda: program.explore(output=None, checkpoint="save"))[0] == "D014"
    assert path.read_bytes() == before


def test_two_searches_do_not_write_to_one_place(program: soter.Program, tmp_path: Path) -> None:
    place = checkpoints.Checkpoint(tmp_path / "save" / "T.checkpoint", 60.0, {})
    file = place.open(".ending")
    code, text = code_of(lambda: program.explore(output=None, checkpoint="save"))
    assert (code, "another search writes" in text) == ("D014", True)
    os.close(file)


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ({"checkpoint": "save", "resume": "save"}, "`checkpoint` does nothing beside `resume`"),
        ({"checkpoint": "save", "strategy": "falsify"}, "without `strategy bfs`"),
        ({"resume": "save", "strategy": "random"}, "`resume` does nothing without"),
        ({"checkpoint": "save", "checkpoint_every": 0}, "`checkpoint_every` cannot be `0`"),
        ({"checkpoint": "save", "checkpoint_every": True}, "`checkpoint_every` cannot be `True`"),
        ({"checkpoint_every": 5.0}, "does nothing without `checkpoint` or `resume`"),
        ({"checkpoint": ""}, "a checkpoint needs a folder"),
        ({"resume": ""}, "a checkpoint needs a folder"),
    ],
)
def test_what_cannot_be_asked_for(how: dict[str, Any], said: str, program: soter.Program) -> None:
    code, text = code_of(lambda: program.explore(output=None, **how))
    assert code == "U001"
    assert said in text


def test_a_folder_that_cannot_be_written_is_told_before(
    program: soter.Program, tmp_path: Path
) -> None:
    (tmp_path / "save").write_text("a file")
    assert code_of(lambda: program.explore(output=None, checkpoint="save"))[0] == "D006"


def test_there_has_to_be_something_to_go_on_from(program: soter.Program) -> None:
    assert "there is no such folder" in code_of(resumed)[1]
    begun(program)
    path = Path("save") / "T.checkpoint"
    path.rename(path.with_name("Another.checkpoint"))
    code, text = code_of(resumed)
    assert code == "D012"
    assert "no such file; those there are of Another" in text


# ---------------------------------------------------------------- damage


def test_what_is_no_regular_file_is_not_waited_for(program: soter.Program) -> None:
    path = begun(program)
    path.unlink()
    os.mkfifo(path)
    code, text = code_of(resumed)
    assert code == "D012"
    assert "is no checkpoint: it is no regular file" in text


def test_cut_off_anywhere_it_is_refused(program: soter.Program) -> None:
    path = begun(program)
    whole = path.read_bytes()
    sizes = {0, 1, len(MAGIC), HEAD - 1, HEAD, HEAD + 1, len(whole) - 8, len(whole) - 1}
    sizes |= set(range(0, len(whole), max(len(whole) // 60, 1)))
    for size in sorted(sizes):
        path.write_bytes(whole[:size])
        assert code_of(resumed)[0] == "D012", size
    path.write_bytes(whole + b"\0")
    assert code_of(resumed)[0] == "D012"
    path.write_bytes(whole)
    assert resumed().verdict == "exhausted"


def test_with_any_bit_turned_it_is_refused(program: soter.Program) -> None:
    path = begun(program)
    whole, random = path.read_bytes(), chance(3)
    places = [*range(0, len(MAGIC) + 80, 7), *range(HEAD, HEAD + 136, 8), len(whole) - 1]
    places += [random.randrange(len(whole)) for _ in range(60)]
    for at in places:
        damaged = bytearray(whole)
        damaged[at] ^= 1 << random.randrange(8)
        path.write_bytes(damaged)
        assert code_of(resumed)[0] == "D012", at


@pytest.mark.parametrize(
    "change",
    [{"schema": 2}, {"soter": "0.0.1"}, {"code": "0" * 64}, {"payload": None}, {"schema": None}],
)
def test_of_another_version_it_is_refused(change: dict[str, Any], program: soter.Program) -> None:
    path = begun(program)
    whole = path.read_bytes()
    path.write_bytes(_with_head(whole, change) + whole[HEAD:])
    assert code_of(resumed)[0] == "D012"


def test_what_is_sealed_and_makes_no_sense_is_refused(program: soter.Program) -> None:
    """The seals alone do not decide: the explorer takes nothing that does not fit."""
    path = begun(program)
    whole = path.read_bytes()
    numbers = np.frombuffer(whole[HEAD : HEAD + 16 * 8], dtype=np.uint64)
    for number in range(7):
        wrong = numbers.copy()
        wrong[number] += 1
        _sealed(path, whole, wrong.tobytes() + whole[HEAD + 16 * 8 :])
        assert code_of(resumed)[0] == "D012", number
    for size in range(0, len(whole) - HEAD, (len(whole) - HEAD) // 40):
        _sealed(path, whole, whole[HEAD : HEAD + size])
        assert code_of(resumed)[0] == "D012", size


def _with_head(whole: bytes, change: dict[str, Any]) -> bytes:
    start = len(MAGIC) + 65
    head = {**json.loads(whole[start:HEAD]), **change}
    rest = json.dumps({k: v for k, v in head.items() if v is not None}).encode()
    rest = rest.ljust(HEAD - start)
    return MAGIC + hashlib.sha256(rest).hexdigest().encode() + b"\n" + rest


def _sealed(path: Path, whole: bytes, payload: bytes) -> None:
    told = {"bytes": len(payload), "sha256": hashlib.sha256(payload).hexdigest()}
    path.write_bytes(_with_head(whole, {"payload": told}) + payload)
    assert bytes(read_checkpoint(path).payload) == payload


# ---------------------------------------------------------------- writing


def test_a_disk_that_is_full_ends_no_search(
    program: soter.Program, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(checkpoints, "seal", full)
    (test,) = program.explore(output=None, reduction="none", checkpoint="save").tests
    assert test.verdict == "exhausted"
    assert test.checkpoint is not None
    assert (test.checkpoint.states, test.checkpoint.problem) == (0, "no space left on device")
    assert not list(test.checkpoint.path.parent.iterdir())


def test_it_is_not_written_where_a_violation_is_found(tmp_path: Path) -> None:
    (tmp_path / "v.soter").write_text(wanderers(160, most=15))
    report = soter.load(tmp_path / "v.soter").explore(output=None, checkpoint=tmp_path / "save")
    (test,) = report.tests
    assert test.verdict == "violated"
    assert test.checkpoint is not None
    assert test.checkpoint.states == 0


def test_while_it_is_searched_it_is_written_again_and_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "w.soter").write_text(ENDLESS)
    written: list[int] = []
    honest = checkpoints.take_place

    def counted(made: Path, path: Path) -> None:
        honest(made, path)
        written.append(read_checkpoint(path).head["states"])

    def looked(how: SearchProgress) -> None:
        told.append(how.saved)
        if len(written) >= 3:
            raise KeyboardInterrupt

    told: list[int] = []
    monkeypatch.setattr(checkpoints, "take_place", counted)
    report = soter.load(tmp_path / "w.soter").explore(
        output=None,
        reduction="none",
        checkpoint=tmp_path,
        checkpoint_every=0.01,
        progress=looked,
        partial=True,
    )
    assert report.tests[0].bound == "interrupted"
    assert len(written) > 3
    assert written == sorted(written)
    assert written[2] == told[-1]
    assert written[-1] == report.tests[0].states


def command(*more: str) -> list[str]:
    """`soter test` on the program that takes long."""
    own = [sys.executable, "-m", "soter.cli.main", "test", "w.soter", "--reduction", "none"]
    return [*own, "--json", *more]


@pytest.mark.parametrize("ends", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_ended_from_outside_it_goes_on(ends: signal.Signals, tmp_path: Path) -> None:
    (tmp_path / "w.soter").write_text(LONG)
    place = tmp_path / "save" / "T.checkpoint"
    begin = command("--checkpoint", "save", "--checkpoint-every", "0.2")
    with processes.started(begin, cwd=tmp_path, stdout=processes.PIPE) as process:
        processes.until(place.exists, process)
        process.send_signal(ends)
        out, _ = process.communicate(timeout=processes.TIMEOUT_S)
    if ends != signal.SIGKILL:
        assert process.returncode == 130
        (test,) = json.loads(out)["tests"]
        assert test["checkpoint"]["states"] == test["states"]
        assert [p.name for p in place.parent.iterdir()] == [place.name]
    saved = read_checkpoint(place).head["states"]
    assert saved > 0
    more = str(saved + 100_000)
    done = processes.run(
        command("--resume", "save", "--max-states", more), cwd=tmp_path, capture_output=True
    )
    (test,) = json.loads(done.stdout)["tests"]
    assert (done.returncode, test["bound"]) == (4, "states")
    assert test["checkpoint"]["resumed_states"] == saved
    assert test["checkpoint"]["states"] == test["states"] >= saved + 100_000
