"""What DM or SC read together is the state at one instant, or the program is not rechecked."""

from __future__ import annotations

from contextlib import nullcontext
from typing import TYPE_CHECKING, Any

import pytest

import soter
from soter.certificate.extras.estimates_and_shield import command_memory_ns
from soter.certificate.reading.case_model import CaseModel
from soter.certificate.reading.module_facts import DiffersError
from soter.certificate.report import NotRecheckedError
from soter.certificate.scope import assumptions_of
from soter.language.front_end import check_file, system_to_prove
from soter.verify.problem.extract import extract
from soter.verify.problem.problem import assumption_texts
from unit.certificate import small_proofs

if TYPE_CHECKING:
    from pathlib import Path

TEXT = """soter 1;
topic x: float max_age 20ms;
topic y: float max_age 20ms;
topic u: float in [-1.0, 1.0];
plant P period 10ms { reads u; drives x = p; state p: float; der p = u; }
plant Q period 10ms { drives y = q; state q: float; der q = -q; }
node Fast period 20ms { subscribes x; publishes u; step { publish u = 1.0; } }
node Slow period 20ms { subscribes x, y; publishes u; step { publish u = clamp(-x, -1.0, 1.0); } }
rta M {
  ac Fast;
  sc Slow;
  period 20ms;
  safe abs(x) < 3.0 && abs(y) < 1.0;
  ttf abs(x) > 2.0;
  safer abs(x) < 1.0;
  verify { grid x in [-3.0, 3.0] / 100; grid y in [-1.0, 1.0] / 10; }
}
system S { p: P; q: Q; module M; }
"""
SC = ("clamp(-x,", "clamp(-x - y,")
DM = ("ttf abs(x) > 2.0;", "ttf abs(x) + abs(y) > 2.0;")
CLOCKS = ("plant Q period 10ms", "plant Q period 5ms")


def facts_with(folder: Path, *pairs: tuple[str, str]) -> None:
    text = TEXT
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new)
    path = folder / "two.soter"
    path.write_text(text)
    small_proofs.facts_of(path, "S", "M")


@pytest.mark.parametrize(
    ("declared", "driven", "why"),
    [
        ("float", "u", ""),
        ("float", "2.0 * u", "plant `p` publishes `echo` made of `u`"),
        ("float in [-1.0, 1.0]", "u", "plant `p` publishes `echo` made of `u`"),
        # with an error as large as the set of a command the sum may be no number
        ("float", "u; measured echo within 0.1", "plant `p` publishes `echo` made of `u`"),
    ],
)
def test_a_plant_that_publishes_a_command_may_copy_it_and_no_more(
    tmp_path: Path, declared: str, driven: str, why: str
) -> None:
    """A copy to a topic without a set never faults: nothing of the proof is about it."""
    path = tmp_path / "echo.soter"
    text = TEXT.replace("topic u:", f"topic echo: {declared};\ntopic u:")
    path.write_text(text.replace("drives x = p;", f"drives x = p; drives echo = {driven};"))
    (module,) = soter.load(path).verify(cert=tmp_path / "cert", refute=False).modules
    assert module.findings["P2a"].verdict == "proved"
    report = soter.recheck(tmp_path / "cert")
    assert why in report.reason
    assert (report.verdict == "accepted") is not bool(why)


def test_an_error_with_which_a_sum_may_be_no_number_is_not_re_checked(tmp_path: Path) -> None:
    """What is published ends the plant then, also where neither DM nor SC reads it."""
    drives = ("drives x = p;", "drives x = p; drives big = 1e307 * p; measured big within {};")
    topic = ("topic u:", "topic big: float;\ntopic u:")
    facts_with(tmp_path, topic, (drives[0], drives[1].format("1e301")))
    with pytest.raises(NotRecheckedError, match="`big` is measured, and the sum may be no number"):
        facts_with(tmp_path, topic, (drives[0], drives[1].format("1.79e308")))


def test_whoever_reads_the_copy_of_a_command_is_not_re_checked(tmp_path: Path) -> None:
    """Of its values nothing is known: no sets may rest on them."""
    path = tmp_path / "echo.soter"
    for reader in (SC, DM):
        text = TEXT.replace("topic u:", "topic echo: float max_age 20ms;\ntopic u:")
        text = text.replace("drives x = p;", "drives x = p; drives echo = u;")
        text = text.replace("subscribes x, y;", "subscribes x, y, echo;")
        path.write_text(text.replace(reader[0], reader[1].replace("y", "echo")))
        model = CaseModel(small_proofs.facts_of(path, "S", "M"), (), ((-3.0, 3.0), (-1.0, 1.0)))
        terms, states = model.new_terms()
        ttf = model.facts.symbol.ttf
        assert ttf is not None
        told: Any = pytest.raises(
            NotRecheckedError, match="`echo` is read, but nobody says its values"
        )
        with told if reader is SC else nullcontext():
            model.sc_commands(terms, states)
        with told if reader is DM else nullcontext():
            model.truth_of(terms, states, ttf, errors=True)


@pytest.mark.parametrize("reader", [SC, DM])
def test_two_clocks_are_rejected_where_both_are_read(
    tmp_path: Path, reader: tuple[str, str]
) -> None:
    facts_with(tmp_path, reader)
    with pytest.raises(DiffersError, match="different times"):
        facts_with(tmp_path, reader, CLOCKS)


def test_two_clocks_are_fine_where_only_one_is_read(tmp_path: Path) -> None:
    facts_with(tmp_path, CLOCKS)


def test_prover_and_re_checker_say_that_sensors_are_on_time(tmp_path: Path) -> None:
    path = tmp_path / "two.soter"
    path.write_text(TEXT)
    said = "sensors publish exactly at their releases, before anybody reads in that instant"
    facts = small_proofs.facts_of(path, "S", "M")
    assert said in [a.text for a in assumptions_of(facts)]
    flat = system_to_prove(check_file(str(path)), "S")
    assert said in assumption_texts(extract(flat, flat.modules[0]).assumptions)


@pytest.mark.parametrize("sc", [(0, 0), (3, 0), (0, 2), (3, 2)])
@pytest.mark.parametrize("acts", [0, 4])
def test_a_replaced_command_counts_for_as_long_as_the_prover_says(
    tmp_path: Path, sc: tuple[int, int], acts: int
) -> None:
    """W: `max_age` of a read, a command that acts late, a period of SC, and its longest step."""
    times = f"late sc {sc[0]}ms; response sc {sc[1]}ms; acts within {acts}ms;"
    path = tmp_path / "two.soter"
    path.write_text(TEXT.replace("verify {", f"verify {{ {times}"))
    flat = system_to_prove(check_file(str(path)), "S")
    own = command_memory_ns(small_proofs.facts_of(path, "S", "M"))
    assert own == extract(flat, flat.modules[0]).times.replaced_window
    assert own == (20 + acts + 20 + sum(sc)) * 1_000_000
