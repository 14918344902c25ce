"""Examples of docs/language.md and docs/evidence.md check clean and run alike on both engines.

The programs of `examples/evidence` check clean, too, and end as they say.
"""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

import soter
from examples_changed import changed
from generators.engine_comparison import call_compiler, write_units
from generators.file_listing import files_in
from generators.shipped_programs import subjects_of
from soter.language.front_end import check_file, system_of
from soter.simulate.run import NativeProgram, run_interpreted
from soter.timing.trusted_thread import timing_of

ROOT = Path(__file__).resolve().parents[2]
PAGES = [(ROOT / "docs" / f"{p}.md").read_text(encoding="utf-8") for p in ("language", "evidence")]
PAGE = "".join(PAGES)
BLOCKS = re.findall(r"^```(soter[^\n]*)\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
TWO_BOXES = """[
  {"low": {"x": 0, "y": 0, "z": 0}, "high": {"x": 1, "y": 1, "z": 5}},
  {"low": {"x": 2, "y": 2, "z": 0}, "high": {"x": 3, "y": 3, "z": 7.5}}
]"""
TWO_PLANS = """[
  {"length": 12.5, "corners": [{"x": 0, "y": 0, "z": 2}, {"x": 3, "y": 4, "z": 2}]},
  {"length": 0, "corners": []}
]"""
DURATION_NS = 2_000_000_000


def _heading(position: int) -> str:
    before = PAGE[: PAGE.index(BLOCKS[position][1])]
    headings: list[str] = re.findall(r"^## (.*)$", before, re.MULTILINE)
    return headings[-1]


@pytest.mark.parametrize("position", range(len(BLOCKS)), ids=_heading)
def test_an_example_checks_clean_and_runs_alike_on_both_engines(
    position: int, tmp_path: Path
) -> None:
    info, text = BLOCKS[position]
    (tmp_path / "two_boxes.json").write_text(TWO_BOXES)
    (tmp_path / "two_plans.json").write_text(TWO_PLANS)
    checked = check_file(str(tmp_path / "example.soter"), text)
    assert [d.message for d in checked.diagnostics.items] == []
    assert info in {"soter", "soter,needs data"}
    for name in checked.systems:
        system = system_of(checked, name)
        native = NativeProgram(system).run(DURATION_NS, 3, hash_trace=True)
        interpreted = run_interpreted(system, DURATION_NS, 3)
        assert native.instants > 0
        assert native.trace_sha256 == interpreted.trace_sha256


def test_the_tests_of_the_pages_end_as_they_say(tmp_path: Path) -> None:
    verdict_by_test: dict[str, str] = {}
    for number, (_, text) in enumerate(BLOCKS):
        path = tmp_path / f"example_{number}.soter"
        path.write_text(text)
        if check_file(str(path)).tests:
            report = soter.load(path).explore(output=None)
            verdict_by_test |= {t.name: t.verdict for t in report.tests}
    assert verdict_by_test == {
        "AsItIs": "exhausted",
        "InItsPlace": "exhausted",
        "InTime": "exhausted",
        "Delayed": "violated",
        "TwoLate": "exhausted",
    }
    for name, verdict in verdict_by_test.items():
        assert re.search(rf"`{name}` is \*{verdict}", PAGE)


def test_both_pages_have_examples() -> None:
    assert min(page.count("\n```soter") for page in PAGES) > 9


# ---------------------------------------------------------------- examples/evidence


@pytest.fixture
def evidence(tmp_path: Path) -> Path:
    """The programs of `examples/evidence`, and the one that they import."""
    shutil.copytree(ROOT / "examples" / "evidence", tmp_path / "evidence")
    (tmp_path / "wall").mkdir()
    shutil.copy(ROOT / "examples" / "wall" / "cart.soter", tmp_path / "wall")
    return tmp_path / "evidence"


@pytest.mark.parametrize(
    "path", files_in(ROOT / "examples" / "evidence", "*.soter"), ids=lambda p: p.stem
)
def test_a_program_about_evidence_gets_no_diagnostics(path: Path) -> None:
    assert [d.message for d in check_file(str(path)).diagnostics.items] == []


def test_the_courier_keeps_its_calendar_and_is_proved_with_it(evidence: Path) -> None:
    path = evidence / "courier.soter"
    (module,) = soter.load(path).verify().modules
    assert module.verdict == "proved"
    assert module.findings["P1c"].verdict == "proved"
    timing = timing_of(system_of(check_file(str(path)), "Corridor"))
    assert timing is not None
    assert timing.verdict == "fits"
    thread = ["Guard.dm", "Guard.Back", "Guard.Learned", "Lamp"]
    assert [r.component.name for r in timing.rows] == thread
    changed(path, " substeps 2", "")
    assert [d.code for d in check_file(str(path)).diagnostics.items] == ["W019"]


CLAMPED = """soter 1;
// SIGN * clamp(-12 a - 3 w, -2, 2), as relu(z + 2) - relu(z - 2) - 2
fun act(x: float[2]): float[1] {
  var h: float[2] = [2.0, -2.0];
  for i in 0..2 {
    var sum = h[i];
    for j in 0..2 { sum = sum + [-12.0, -3.0][j] * x[j]; }
    h[i] = max(sum, 0.0);
  }
  return [SIGN * (h[0] - h[1] - 2.0)];
}
"""


@pytest.mark.parametrize(("sign", "kept"), [("1.0", True), ("-1.0", False), ("0.4", False)])
def test_a_network_that_leads_back_is_proved_and_one_that_does_not_is_not(
    evidence: Path, sign: str, kept: bool
) -> None:
    (evidence / "balance_net.soter").write_text(CLAMPED.replace("SIGN", sign))
    (module,) = soter.load(evidence / "balance.soter").verify(refute=False).modules
    assert (module.findings["P2a"].verdict == "proved") == kept


@pytest.mark.long
def test_the_trained_network_is_proved_and_accepted(evidence: Path) -> None:
    soter.load(evidence / "balance.soter").verify(cert=evidence / "cert", refute=False)
    report = soter.recheck(evidence / "cert")
    assert report.accepted
    assert "P2a" in report.modules[0].confirmed


def test_a_plan_by_radio_is_proved_with_the_lemma(evidence: Path) -> None:
    (module,) = soter.load(evidence / "relayed_plan.soter").verify().modules
    assert module.verdict == "proved"


@pytest.mark.long
def test_a_plan_by_radio_is_not_proved_without_the_lemma(evidence: Path) -> None:
    changed(evidence / "relayed_plan.soter", "    lemma Good(sent);\n", "")
    (module,) = soter.load(evidence / "relayed_plan.soter").verify().modules
    assert module.verdict == "undecided"


def test_only_faults_outside_of_the_assumptions_bring_the_cart_to_the_wall(evidence: Path) -> None:
    program = soter.load(evidence / "cart_faults.soter")
    inside, outside = (
        program.campaign(system, flights=48, output=evidence / system).result
        for system in ("Inside", "Outside")
    )
    assert (inside.flights_violated, outside.flights_violated) == (0, 1)
    assert outside.violated_inside == 0


def test_the_c_of_an_sc_that_waits_for_a_late_dm_has_no_warning(tmp_path: Path) -> None:
    subjects = subjects_of(ROOT / "examples" / "evidence" / "cart_faults.soter", 10)
    assert [s.system.name for s in subjects] == ["Inside", "Outside"]
    call_compiler(tmp_path, "-c", str(write_units(subjects, tmp_path)))


@pytest.mark.long
def test_a_controller_for_the_reel_is_found_and_proved(evidence: Path) -> None:
    path, _ = soter.load(evidence / "reel.soter").synthesize()
    (module,) = soter.load(path).verify().modules
    assert module.verdict == "proved"
