"""`soter verify`: verdicts, what they rest on, exit codes, and the JSON document."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from soter.api.program import Program
from soter.verify.diagnosis import tried_remedies

if TYPE_CHECKING:
    from collections.abc import Callable

    Soter = Callable[..., Any]
    Golden = Callable[[str, str], None]

ROOT = Path(__file__).resolve().parents[3]
CART = (ROOT / "examples" / "wall" / "cart.soter").read_text("utf-8")
COARSE = (("/ 400", "/ 100"), ("/ 320", "/ 80"), ("tau * tau) + 0.12", "tau * tau) + 0.8"))
PROPERTIES = ["P1a", "P1b", "P1c", "P2a", "P2b", "P3", "ttf", "safer", "start", "failsafe", "DM"]


def write(here: Path, *pairs: tuple[str, str]) -> str:
    """A coarse cart with some changes, as a file."""
    text = CART
    for old, new in (*COARSE, *pairs):
        assert old in text, old
        text = text.replace(old, new)
    (here / "coarse.soter").write_text(text)
    return "coarse.soter"


def steady(text: str) -> str:
    """Without times and hashes."""
    text = re.sub(r"(proved|assumed|assumptions|\)) +[0-9.]+ (s|ms)", r"\1  TIME", text)
    text = re.sub(r"─+| +time +how", "─", text)
    return re.sub(r"\b[0-9a-f]{12}\b", "HASH", text)


def test_what_it_says_of_a_proved_module(
    soter: Soter, here: Path, golden: Golden, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    done = soter("verify", write(here))
    assert done.exit == 0
    assert "PROVED under 16 assumptions" in done.out
    golden("cli/verify.txt", steady(done.out))


def test_verify_and_run_say_one_s_0_and_why_not_ttf_is_another_figure(
    soter: Soter, here: Path
) -> None:
    shuttle = (ROOT / "examples" / "wall" / "shuttle.soter").read_text("utf-8")
    (here / "shuttle.soter").write_text(shuttle)
    proved = soter("verify", "shuttle.soter", "--no-refute")
    (share,) = re.findall(
        r"^S_0 ([0-9.]+%) of the estimates, .*; not ttf: the states", proved.out, re.MULTILINE
    )
    (of_states,) = re.findall(r"not ttf ([0-9.]+%)", proved.out)
    assert share != of_states
    assert f"on {share} of the estimates (S_0)" in soter("run", "shuttle.soter").out


def test_the_document_has_every_property(soter: Soter, here: Path) -> None:
    done = soter("verify", write(here), "--json")
    module = done.document["modules"]["SafeCart"]
    assert done.exit == 0
    assert module["verdict"] == "proved"
    assert list(module["properties"]) == PROPERTIES
    assert module["cells"] == 8000
    assert 0.5 < module["core_share"] < 1.0
    assert module["horizon_s"] == module["horizon_needed_s"] == 0.074
    assert 1.0 < module["recover_s"] < 10.0


@pytest.mark.parametrize(
    ("at", "told"),
    [
        (
            "soter.verify.claims.start.check_start",
            "P2a shown, P3 shown, ttf shown, safer shown; ended",
        ),
        ("soter.verify.refute.enter_refutations", "P2a proved, P2b proved, P3 proved"),
        ("soter.verify.command.enter_cost", "P2a proved, P2b proved, P3 proved"),
        ("soter.verify.verify_module.announce_work", "no claim settled"),
    ],
)
def test_who_ends_it_is_told_what_is_settled(
    soter: Soter, here: Path, monkeypatch: pytest.MonkeyPatch, at: str, told: str
) -> None:
    def pressed(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(at, pressed)
    done = soter("verify", write(here))
    assert done.exit == 130
    assert "interrupted" in done.err
    assert "SafeCart: " in done.err
    assert told in done.err


@pytest.mark.long
def test_a_refutation_comes_with_its_run(soter: Soter, here: Path) -> None:
    ttf = "ttf Room(motion, 0.12) < 0.0 || abs(motion.v) > FAST;"
    done = soter("verify", write(here, (ttf, "ttf false;")), "--json")
    properties = done.document["modules"]["SafeCart"]["properties"]
    assert done.exit == 3
    assert properties["P2a"]["verdict"] == "proved"
    assert properties["ttf"]["verdict"] == properties["P3"]["verdict"] == "refuted"
    assert (here / properties["ttf"]["counterexample"]).is_file()


def test_what_is_undecided_says_where_and_what_would_help(
    soter: Soter, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tried_remedies, "LEAST_S", 1.0)
    wind = ("wind: float in [-0.2, 0.2]", "wind: float in [-2.5, 2.5]")
    done = soter("verify", write(here, wind), "--no-refute")
    assert done.exit == 4
    assert "UNDECIDED" in done.out
    assert "  where  c.x in [" in done.out
    assert "  help   " in done.out


def test_what_is_open_is_told_where_it_is_before_anything_is_tried_and_to_who_ends_it(
    soter: Soter, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[str] = []

    def tried(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(tried_remedies, "announce", lambda text: told.append(text()))
    monkeypatch.setattr(tried_remedies, "ordered_trials", tried)
    wind = ("wind: float in [-0.2, 0.2]", "wind: float in [-2.5, 2.5]")
    done = soter("verify", write(here, wind), "--no-refute")
    assert (done.exit, done.out) == (130, "")
    assert told[0].startswith("SafeCart is UNDECIDED (P2a, ")
    assert "\n    where  c.x in [" in told[0]
    (why,) = told[1].splitlines()
    assert f"    why    {why.removeprefix('SafeCart: ')}" in done.err
    assert "    where  c.x in [" in done.err


def test_a_program_that_determines_no_problem_is_told_so(soter: Soter, here: Path) -> None:
    grid = re.search(r"    grid .*\n", CART)
    assert grid is not None
    (here / "bare.soter").write_text(CART.replace(grid.group(), ""))
    done = soter("verify", "bare.soter", "--budget", "0", "--json")
    assert done.exit == 1
    assert done.codes == ["R008"]


def test_what_is_found_is_told_and_written(soter: Soter, here: Path) -> None:
    grid = re.search(r"    grid .*\n", CART)
    assert grid is not None
    (here / "bare.soter").write_text(CART.replace(grid.group(), ""))
    done = soter("verify", "bare.soter", "--write", "--json")
    assert done.exit == 0
    (search,) = done.document["searches"]
    assert search["proved"]
    assert search["found"] == search["tries"][-1]["hints"]
    assert search["found"] in (here / "bare.soter").read_text()
    again = soter("verify", "bare.soter", "--write")
    assert "nothing was written" in again.out
    assert "what it gave" not in again.out


HOPPER = """soter 1;
param TOP: float = 0.8;
topic apex: float max_age 200ms;
topic thrust: float in [0.0, 0.3] = 0.0;
plant Hopper period 400ms {
  reads thrust;
  drives apex = h;
  state h: float = 0.4;
  next h = 0.75 * h + thrust;
  measured apex within 0.01;
}
node Policy period 400ms { publishes thrust; step { publish thrust = 0.25; } }
node Hold period 400ms {
  subscribes apex;
  publishes thrust;
  step { publish thrust = clamp(0.1 + 0.5 * (0.4 - apex), 0.0, 0.3); }
}
rta Envelope { ac Policy; sc Hold; period 400ms; safe apex > 0.15 && apex < TOP; }
system S default { h: Hopper; module Envelope; }
"""


def test_the_document_says_that_hints_were_written(soter: Soter, here: Path) -> None:
    (here / "hop.soter").write_text(HOPPER)
    done = soter("verify", "hop.soter", "--write", "--no-refute", "--json")
    assert done.document["written"] == ["hop.soter"]
    again = soter("verify", "hop.soter", "--write", "--no-refute", "--json")
    assert "written" not in again.document


def test_what_writes_hints_down_asks_for_the_same_parameters(soter: Soter, here: Path) -> None:
    (here / "hop.soter").write_text(HOPPER)
    done = soter("verify", "hop.soter", "--set", "TOP=0.7", "--no-refute")
    assert "`soter verify hop.soter --set TOP=0.7 --write` puts it" in done.out


@pytest.mark.parametrize("why", ["read-only", "no plain file"])
def test_a_file_that_cannot_be_written_is_refused_before_hints_are_looked_for(
    soter: Soter, here: Path, monkeypatch: pytest.MonkeyPatch, why: str
) -> None:
    (here / "hop.soter").write_text(HOPPER)
    (here / "hop.soter").chmod(0o444)
    monkeypatch.setattr("soter.api.program.Program.verify", None)
    name = "hop.soter" if why == "read-only" else "/dev/null"
    done = soter("verify", name, "--write")
    assert done.exit == 1
    assert why in done.err
    assert "soter fmt" not in done.err


def test_hints_are_not_written_over_what_somebody_wrote_meanwhile(
    soter: Soter, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (here / "hop.soter").write_text(HOPPER)
    verify, changed = Program.verify, HOPPER.replace("TOP: float = 0.8", "TOP: float = 0.6")

    def slowly(self: Program, *words: Any, **how: Any) -> Any:
        report = verify(self, *words, **how)
        (here / "hop.soter").write_text(changed)
        return report

    monkeypatch.setattr(Program, "verify", slowly)
    done = soter("verify", "hop.soter", "--write", "--no-refute")
    assert done.exit == 1
    assert "has changed since it was read" in done.err
    assert (here / "hop.soter").read_text() == changed


def test_hints_of_an_imported_module_are_not_promised(soter: Soter, here: Path) -> None:
    library = HOPPER[: HOPPER.index("system S")]
    (here / "lib.soter").write_text(library)
    (here / "main.soter").write_text(
        'soter 1;\nimport "lib.soter" as lib;\n'
        "system S { h: lib.Hopper; module lib.Envelope; until 1s; }\n"
    )
    done = soter("verify", "main.soter")
    assert done.exit == 1
    assert "R008" in done.err
    assert "finds a grid" not in done.err
    assert "stand in the file that is verified" in done.err


def test_a_module_that_is_not_there_is_a_mistake_of_the_command_line(soter: Soter) -> None:
    done = soter("verify", "cart.soter", "--module", "SafeCat", "--json")
    assert done.exit == 2
    assert done.codes == ["U008"]


def test_mistakes_of_the_program_come_first(soter: Soter, here: Path) -> None:
    (here / "wrong.soter").write_text("soter 1;\nconst A: int = true;\n")
    done = soter("verify", "wrong.soter", "--json")
    assert done.exit == 1
    assert done.codes == ["T001"]


def test_a_report_and_a_certificate_are_written(soter: Soter, here: Path) -> None:
    name = write(here)
    done = soter("verify", name, "--report", "proof.html", "--cert", "proof", "--json")
    assert done.exit == 0
    assert (done.document["report"], done.document["cert"]) == ("proof.html", "proof")
    page = (here / "proof.html").read_text("utf-8")
    command = "<dd>soter verify coarse.soter</dd>"
    for text in ("SafeCart", "R(H)", "disturbances stay within their bounds", "sha256", command):
        assert text in page
    assert (here / "proof" / "manifest.json").exists()


def test_what_has_no_declared_error_is_said_to_be_exact(soter: Soter, here: Path) -> None:
    error = ("motion.x within 0.02, motion.v within 0.05", "motion.x within 0.02")
    done = soter("verify", write(here, error), "--no-refute")
    assert "within their bounds: motion.x within 0.02 m\n" in done.out
    assert "estimates are exact: motion.v\n" in done.out


def test_an_assumed_property_stands_in_the_headline(soter: Soter, here: Path) -> None:
    late, response = "    late dm 1ms, sc 1ms;\n", "    response dm 1ms, sc 1ms;\n"
    acts = "    acts within 1ms;\n"
    done = soter("verify", write(here, (late, ""), (response, ""), (acts, "")))
    assert done.exit == 0
    assert re.search(r"PROVED under \d+ assumptions \(P1c, failsafe assumed\)", done.out)


@pytest.mark.parametrize("name", ["--help", "-h"])
def test_help_has_examples_and_exit_codes(soter: Soter, name: str) -> None:
    out = soter("verify", name).out
    assert "soter verify cart.soter --cert proof/" in out
    assert "4 undecided" in out


@pytest.mark.long
def test_an_invariant_that_fails_inside_a_proof_is_exit_70(
    soter: Soter, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> None:
        raise AssertionError("an invariant")

    monkeypatch.setattr("soter.verify.grid.claims.GridProof.find_core", broken)
    (here / "lift.soter").write_text((ROOT / "examples" / "wall" / "lift.soter").read_text("utf-8"))
    done = soter("verify", "lift.soter")
    assert done.exit == 70
    assert "undecided" not in done.out.lower()
