"""`soter verify` of what was proved before and has not changed: told again, and nothing else is."""

from __future__ import annotations

import json
import os
import shutil
import sys
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from soter.api.program import Program
from soter.cli.main import main
from soter.cli.terminal import stored_outcome as store
from soter.cli.terminal.stored_outcome import Printout, StoredOutcome
from soter.cli.verify import TOLD_AGAIN
from soter.native import cache
from soter.native.compiler import Compiler

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    Verify = Callable[..., tuple[int, str, str]]

TANK = """soter 1;
import "rates.soter" as rates;
topic level: float in [-5.0, 5.0] max_age 20ms;
topic flow: float in [-1.0, 1.0];
const TOP: float[1] = data "top.json";
param GAIN: float = 1.0 in [0.5, 2.0];
plant Tank period 10ms {
  reads flow;
  drives level = h;
  state h: float in [-0.5, 0.5];
  der h = rates.FLOW * flow;
}
node Fill period 10ms { publishes flow; step { publish flow = 1.0; } }
node Drain period 10ms {
  subscribes level; publishes flow;
  step { publish flow = clamp(-GAIN * level, -1.0, 1.0); }
}
rta Guard {
  ac Fill; sc Drain; period 50ms;
  safe abs(level) < TOP[0];
  verify {
    grid level in [-4.0, 4.0] / 80;
    late dm 1ms, sc 1ms; response dm 1ms, sc 1ms; acts within 1ms;
  }
}
system S default { t: Tank; module Guard; until 1s; }
system T { t: Tank; module Guard; until 2s; }
"""
RATES = "soter 1;\nconst FLOW: float = 1.0;\n"


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cache of these tests' own."""
    return tmp_path_factory.mktemp("compiled")


@pytest.fixture
def tank(here: Path, compiled: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A small program in three files, and a cache that has nothing but what was compiled."""
    for outcome in compiled.glob(f"{store.NAME}-*"):
        shutil.rmtree(outcome)
    monkeypatch.setenv("SOTER_CACHE", str(compiled))
    (here / "rates.soter").write_text(RATES)
    (here / "top.json").write_text("[3.5]")
    (here / "tank.soter").write_text(TANK)
    return here / "tank.soter"


@pytest.fixture
def verify(
    tank: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Verify:
    """`verify(*words)`, as a process of its own does it: exit code, output, standard error."""

    def run(*words: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["soter", "verify", tank.name, *words])
        capsys.readouterr()
        code = main()
        out, err = capsys.readouterr()
        return code, out, err

    return run


def unproved(monkeypatch: pytest.MonkeyPatch) -> None:
    """From here on nothing can be proved, nor any program read."""

    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("it was proved again")

    monkeypatch.setattr(Program, "verify", refuse)
    monkeypatch.setattr(Program, "__init__", refuse)


def test_the_same_text_and_document_come_again_without_a_proof_at_any_width_and_in_colour(
    verify: Verify, tank: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert tank.exists()
    code, out, err = verify()
    assert code == 0
    assert "PROVED" in out
    assert TOLD_AGAIN not in err
    unproved(monkeypatch)
    assert verify()[:2] == (code, out)
    assert TOLD_AGAIN in verify()[2]
    document = json.loads(verify("--json")[1])
    assert document["verdict"] == "proved"
    assert document["exit"] == 0
    monkeypatch.setenv("COLUMNS", "60")
    narrow = verify()[1]
    assert narrow != out
    assert narrow.split() != []
    assert max(map(len, narrow.splitlines()[4:10])) <= 60
    monkeypatch.setenv("FORCE_COLOR", "1")
    assert "\x1b[1;32mPROVED" in verify()[1]


def test_what_is_told_again_is_what_a_proof_says(
    verify: Verify, tank: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of one report: the text of a fresh run and of the stored one, and both documents."""
    made = Program.verify
    reports: list[Any] = []

    def once(self: Program, *words: Any, **how: Any) -> Any:
        if not reports:
            reports.append(made(self, *words, **how))
        return reports[0]

    monkeypatch.setattr(Program, "verify", once)
    assert tank.exists()
    monkeypatch.setattr("soter.cli.verify.store_outcome", lambda *_: None)
    fresh = [verify(*words)[1] for words in ((), ("--json",))]
    monkeypatch.setattr("soter.cli.verify.store_outcome", store.store_outcome)
    verify()
    again = [verify(*words) for words in ((), ("--json",))]
    assert all(TOLD_AGAIN in told[2] for told in again)
    assert [told[1] for told in again] == fresh


def test_what_was_found_is_told_again_of_the_text_in_which_it_was_looked_for_and_of_no_other(
    verify: Verify, tank: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bare = TANK.replace("    grid level in [-4.0, 4.0] / 80;\n", "").replace(
        "topic level: float in [-5.0, 5.0]", "topic level: float"
    )
    tank.write_text(bare)
    code, out, _ = verify("--no-refute")
    assert code == 0
    assert "says no grid and no `rest`; tried" in out
    with monkeypatch.context() as refusing:
        unproved(refusing)
        assert verify("--no-refute")[:2] == (code, out)
    assert "written" in verify("--no-refute", "--write")[1]
    code, out, err = verify("--no-refute")
    assert code == 0
    assert TOLD_AGAIN not in err
    assert "tried" not in out.partition("PROVED")[0]


@pytest.mark.parametrize(
    "words",
    [
        ("--set", "GAIN=1.5"),
        ("--module", "Guard"),
        ("--system", "T"),
        ("--no-refute",),
        ("--cert", "proof"),
        ("--report", "proof.html"),
        ("--format", "github"),
    ],
)
def test_who_asks_something_else_gets_a_proof(
    verify: Verify, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...]
) -> None:
    verify()
    unproved(monkeypatch)
    assert verify()[0] == 0
    assert verify(*words)[0] == 70


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("tank.soter", "3.5", "3.5"),
        ("tank.soter", "until 1s", "until 3s"),
        ("rates.soter", "1.0", "1.5"),
        ("top.json", "3.5", "3.0"),
    ],
)
def test_a_change_of_any_file_is_noticed_and_taken_back_it_is_as_before(
    verify: Verify, tank: Path, monkeypatch: pytest.MonkeyPatch, name: str, old: str, new: str
) -> None:
    verify()
    path = tank.parent / name
    text = path.read_text()
    path.write_text(text.replace(old, new))
    unproved(monkeypatch)
    assert verify()[0] == (0 if old == new else 70)
    path.write_text(text)
    assert verify()[0] == 0
    path.unlink()
    assert verify()[0] == 70


def test_what_is_not_proved_is_verified_again(
    verify: Verify, tank: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tank.write_text(TANK.replace("-GAIN", "GAIN"))
    assert verify("--no-refute")[0] == 4
    unproved(monkeypatch)
    assert verify("--no-refute")[0] == 70


def test_warnings_come_again_from_the_program_itself(
    verify: Verify, tank: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tank.write_text(TANK + "topic nobody: float;\n")
    code, out, err = verify()
    assert code == 0
    assert "W001" in err
    monkeypatch.setattr(Program, "verify", None)
    again = verify()
    assert again[:2] == (code, out)
    assert again[2] == f"{TOLD_AGAIN}\n{err}"
    assert [d["code"] for d in json.loads(verify("--json")[1])["diagnostics"]] == ["W001"]


def test_who_calls_main_in_a_process_of_their_own_always_gets_a_proof(
    verify: Verify, tank: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    verify()
    unproved(monkeypatch)
    assert main(["verify", tank.name]) == 70


# ---------------------------------------------------------------- the store

OUTCOME = StoredOutcome(0, {"n": 0.1}, Printout(["said", [["a"], [["b"]]]]))


@pytest.fixture
def stored(here: Path, monkeypatch: pytest.MonkeyPatch) -> Mapping[Path, str]:
    monkeypatch.setenv("SOTER_CACHE", str(here / "cache"))
    files = [here / "main.soter", here / "other.soter"]
    for path in files:
        path.write_text(path.name)
    contents = {path: store._file_sha256(str(path)) for path in files}
    store.store_outcome("main.soter", ("a", "b"), contents, OUTCOME)
    return contents


def told(*words: str, file: str = "main.soter") -> StoredOutcome | None:
    return store.stored_outcome(file, words or ("a", "b"))


def test_an_outcome_comes_back_as_it_was(stored: Mapping[Path, str]) -> None:
    assert stored
    again = told()
    assert again is not None
    assert (again.exit, again.fields) == (OUTCOME.exit, OUTCOME.fields)
    assert again.printed.parts == OUTCOME.printed.parts
    assert told("a") is None
    assert told("ab", "") is None
    assert told(file="other.soter") is None


def test_another_soter_compiler_python_or_package_is_another_question(
    stored: Mapping[Path, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert stored
    changes: dict[str, Any] = {
        "soter_sha256": lambda: "0" * 64,
        "find_compiler": lambda: Compiler(("cc",), "another"),
        "version": lambda name: "0" if name == "numpy" else version(name),
    }
    for name, other in changes.items():
        with monkeypatch.context() as patch:
            patch.setattr(store, name, other)
            assert told() is None, name
        assert told() is not None
    with monkeypatch.context() as patch:
        patch.setattr(sys, "version", "4.0")
        assert told() is None


def test_what_was_changed_while_it_was_proved_is_not_told_of_the_new_text(
    stored: Mapping[Path, str], here: Path
) -> None:
    (here / "main.soter").write_text("changed meanwhile")
    store.store_outcome("main.soter", ("late",), stored, OUTCOME)
    assert told("late") is None
    (here / "main.soter").write_text("main.soter")
    assert told("late") is not None


def test_a_program_that_reads_another_file_by_now_is_found_under_its_own_list(
    stored: Mapping[Path, str], here: Path
) -> None:
    more = here / "more.soter"
    more.write_text("x")
    store.store_outcome("main.soter", ("a", "b"), {more: store._file_sha256(str(more))}, OUTCOME)
    assert told() is not None
    more.write_text("y")
    assert told() is None
    assert stored


def test_what_others_could_have_written_or_nobody_can_read_is_no_outcome(
    stored: Mapping[Path, str], here: Path
) -> None:
    assert stored
    (entry,) = (here / "cache").glob(f"{store.NAME}-*")
    listed = store._file_list_path("main.soter")
    listed.chmod(0o666)
    assert told() is None
    listed.chmod(0o600)
    assert told() is not None
    listed.write_text("[")
    assert told() is None
    store._write_file_list("main.soter", [str(p) for p in stored])
    assert told() is not None
    (entry / store.FILE).write_text("{}")
    assert told() is None, "its seal is broken"


def test_what_a_path_leads_to_counts_and_not_how_it_reads(
    stored: Mapping[Path, str], here: Path
) -> None:
    (here / "deep" / "er").mkdir(parents=True)
    (here / "link").symlink_to(here / "deep" / "er")
    by_link = Path("link/../main.soter")
    (here / "deep" / "main.soter").write_text("main.soter")
    store.store_outcome(str(by_link), ("a", "b"), {by_link: stored[here / "main.soter"]}, OUTCOME)
    assert told(file=str(by_link)) is not None
    (here / "deep" / "main.soter").write_text("changed")
    assert told(file=str(by_link)) is None


def test_a_pipe_is_not_read_to_see_whether_it_is_the_same(
    stored: Mapping[Path, str], here: Path
) -> None:
    assert stored
    (here / "main.soter").unlink()
    os.mkfifo(here / "main.soter")
    assert told() is None


def test_a_cache_that_refuses_is_no_error(
    stored: Mapping[Path, str], monkeypatch: pytest.MonkeyPatch, here: Path
) -> None:
    (here / "file").write_text("")
    monkeypatch.setenv("SOTER_CACHE", str(here / "file"))
    store.store_outcome("main.soter", ("a", "b"), stored, OUTCOME)
    assert told() is None
    assert cache.cache_dir() == here / "file"
