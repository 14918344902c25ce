"""A proof that leaves AC nothing says so wherever the verdict is read."""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING

import numpy as np
import pytest

import soter
from soter.cli.main import main
from soter.language.front_end import check_file
from soter.verify.chosen_modules import modules_of, problems_of
from soter.verify.claims.results import ModuleResult  # noqa: TC001 - pytest reads annotations
from soter.verify.diagnosis.vacuity import RARE_SHARE
from soter.verify.verify_module import verify_module
from unit.verify.diagnosis.tank_modules import TANK, changed, explained

if TYPE_CHECKING:
    from pathlib import Path

TTF = "ttf level < 0.25 || level > 1.75;"
WITH_MODE = (
    ("state h: float = 1.0;", "state h: float = 1.0;\n  state kind: int in [0, 3] = 0;"),
    ("drives level = h;", "drives level = h;\n  drives kind = kind;"),
    ("topic pump", "topic kind: int in [0, 3] max_age 100ms;\ntopic pump"),
)


def proved(text: str) -> ModuleResult:
    checked = check_file("tank.soter", text)
    assert checked.ok, [d.message for d in checked.diagnostics.items]
    (problem,) = problems_of(modules_of(checked, None, None, {}))
    module_result = verify_module(problem, refute=False)
    assert module_result.verdict == "proved", {n: f.text for n, f in module_result.findings.items()}
    return module_result


def test_a_useful_module_is_just_proved() -> None:
    module_result = proved(TANK)
    assert module_result.vacuity is None
    assert module_result.headline == "proved"


def test_a_safe_that_reads_nothing_says_nothing() -> None:
    module_result = proved(changed(("safe level > 0.2 && level < 1.8;", "safe true;")))
    assert (
        module_result.headline == "proved, but `safe` reads no topic: it says nothing of the plant"
    )
    assert module_result.findings["P2a"].text.startswith("of nothing: `safe` reads no topic")


def test_ttf_true_leaves_ac_nothing() -> None:
    module_result = proved(changed((TTF, "ttf true;")))
    assert module_result.vacuity is not None
    assert (module_result.vacuity.how_often, module_result.vacuity.what) == ("never", "ttf")
    assert module_result.headline.startswith(
        "proved, but AC never keeps control (`ttf` holds everywhere"
    )
    rows = {n: f.text.startswith("of nothing") for n, f in module_result.findings.items()}
    assert [n for n, nothing in rows.items() if nothing] == ["ttf"]


def test_each_row_that_is_about_no_estimate_says_so() -> None:
    """Of a module that is SC alone both are, and what keeps `safe` is not."""
    alone = changed((TTF, "ttf true;"), ("safer level > 0.4 &&", "safer level > 1.7 &&"))
    checked = check_file("tank.soter", alone)
    (problem,) = problems_of(modules_of(checked, None, None, {}))
    findings = verify_module(problem, refute=False, explain=False).findings
    rows = {n: f.text.startswith("of nothing") for n, f in findings.items()}
    assert [n for n, nothing in rows.items() if nothing] == ["ttf", "safer"]
    assert findings["P2a"].verdict == "proved"


@pytest.mark.parametrize(
    ("part", "taken"),
    [
        ("age(level) >= seconds(0ms)", True),
        ("age(level) < seconds(200ms)", True),  # nothing fresh is as old
        ("age(level) < seconds(60ms) || age(level) > seconds(50ms)", True),
        ("age(level) <= seconds(100ms) && level > 0.1", True),  # where K lies, errors included
        ("age(level) <= seconds(100ms) && level > 1.0", False),
        ("age(level) < seconds(50ms) || age(level) > seconds(60ms)", False),
        ("age(level) > seconds(80ms)", False),
    ],
)
def test_an_age_that_takes_control_whatever_is_fresh(part: str, taken: bool) -> None:
    module_result = proved(changed((TTF, f"ttf level < 0.25 || level > 1.75 || {part};")))
    assert (module_result.vacuity is not None) == taken
    if module_result.vacuity is not None:
        assert (module_result.vacuity.how_often, module_result.vacuity.what) == ("never", "ttf")
        assert "`ttf` holds of whatever is fresh: 100 ms" in module_result.headline


@pytest.mark.parametrize(
    ("safe", "nothing"),
    [
        ("abs(level) >= 0.0", True),
        ("level > -3.0 && level < 3.0", True),  # its set is narrower
        ("level > -1.0 || level < 1.0", True),
        ("level - level < 0.5", True),
        ("sin(level) <= 1.0", True),
        ("atan(level) < 2.0 && exp(level) > -1.0", True),
        ("asin(clamp(level, -1.0, 1.0)) < 2.0", True),
        ("sin(51000.0 * level) <= 1.0", False),  # beyond 10^5 it is no number
        ("level > -1.0 && level < 1.9", False),  # all of the grid, and not all of its values
    ],
)
def test_a_safe_that_no_value_violates_says_nothing(safe: str, nothing: bool) -> None:
    of_two = ("topic level: float", "topic level: float in [-2.0, 2.0]")
    written = ("safe level > 0.2 && level < 1.8;", f"safe {safe};")
    module_result = proved(changed(of_two, written))
    assert (module_result.vacuity is not None) == nothing
    if module_result.vacuity is not None:
        assert "`safe` holds of all values that its topics may have" in module_result.headline


@pytest.mark.parametrize(
    ("safer", "clause", "says"),
    [
        ("level > 0.4 && level < 0.6", "returns never;", "nothing says that AC ever gets control"),
        ("level > 0.4 && level < 1.6", "returns never;", ""),  # it has control from the start on
        ("level > 5.0", "returns never;", "AC never has control"),
    ],
)
def test_control_that_nobody_is_asked_to_give(safer: str, clause: str, says: str) -> None:
    text = changed(("safer level > 0.4 && level < 1.6;", f"safer {safer};\n  {clause}"))
    module_result = proved(text)
    assert ("" if module_result.vacuity is None else module_result.vacuity.text).startswith(says)
    assert (module_result.vacuity is None) == (not says)


def test_a_predicate_that_only_enclosures_cannot_decide_is_seen_through() -> None:
    """Over a cell nothing is known of the sum of the squares; at a point it is 1."""
    wave = "10000.0 * level"
    one = f"sin({wave}) * sin({wave}) + cos({wave}) * cos({wave}) > 0.5"
    module_result = proved(changed((TTF, f"ttf level < 0.25 || level > 1.75 || {one};")))
    (part,) = module_result.cases[0].groups
    assert part.lets_ac is not None
    assert part.lets_ac.mean() > 0.9  # as far as the cells know
    assert module_result.vacuity is not None
    assert module_result.vacuity.how_often == "hardly ever"
    assert "none of the states drawn" in module_result.vacuity.text


@pytest.mark.parametrize(("width", "little"), [(0.002, True), (0.1, False)])
def test_a_sliver_is_hardly_ever_and_more_is_not(width: float, little: bool) -> None:
    ttf = f"ttf level < 1.0 || level > {1.0 + width};"
    module_result = proved(changed((TTF, ttf)))
    assert (module_result.vacuity is not None) == little
    if module_result.vacuity is not None:
        assert module_result.vacuity.how_often == "hardly ever"
        chance = np.random.default_rng(7)
        (part,) = module_result.cases[0].groups
        core = np.flatnonzero(part.core)
        edges = np.asarray(part.edges[0])
        level = chance.uniform(edges[core[0]], edges[core[-1] + 1], 200_000)
        level += chance.uniform(-0.01, 0.01, level.size)
        share = float(((level >= 1.0) & (level <= 1.0 + width)).mean())
        assert module_result.vacuity.share < RARE_SHARE
        assert module_result.vacuity.share == pytest.approx(share, abs=0.004)  # of 2,000 drawn


def test_the_worst_parameter_value_is_named() -> None:
    ttf = "ttf level < 0.25 || level > 1.75 || kind == 2;"
    module_result = proved(changed(*WITH_MODE, (TTF, ttf)))
    assert module_result.vacuity is not None
    assert module_result.vacuity.parameters == (("t.kind", 2),)
    assert module_result.vacuity.text.startswith("with t.kind = 2 AC never keeps control")
    sliver = f"{ttf[:-1]} || (kind == 3 && (level < 1.0 || level > 1.002));"
    two = proved(changed(*WITH_MODE, (TTF, sliver)))
    assert two.vacuity is not None
    assert two.vacuity.text.startswith("with t.kind = 2 and 1 more of 4 AC never keeps control")
    every = proved(changed(*WITH_MODE, (TTF, "ttf true || kind == 2;")))
    assert every.vacuity is not None
    assert every.vacuity.text.startswith("with every parameter value AC never")


def test_computed_predicates_are_measured_as_deployed() -> None:
    text = changed((TTF, ""), ("safer level > 0.4 && level < 1.6;", ""))
    assert proved(text).vacuity is None


def test_a_start_outside_safer_is_a_line_and_no_headline() -> None:
    module_result = proved(changed(("float = 1.0", "float = 1.7")))
    assert module_result.headline == "proved"
    assert "`safer` does not hold" in module_result.at_the_start
    assert not proved(TANK).at_the_start


def test_where_safer_holds_nowhere_nobody_is_said_to_wait_for_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """AC could leave K from everywhere within H: S_0 is empty."""
    computed = changed((TTF, ""), ("safer level > 0.4 && level < 1.6;", ""))
    text = changed(("/ 320;", "/ 320; horizon 12s;"), text=computed)
    module_result = explained(text)
    assert "AC would never get control" in module_result.findings["safer"].text
    assert not module_result.at_the_start
    (tmp_path / "tank.soter").write_text(text)
    assert main(["verify", "--no-refute", str(tmp_path / "tank.soter")]) == 4
    assert "for the same reason as `P2b`" in capsys.readouterr().out


# ---------------------------------------------------------------- wherever it is read


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("vacuous") / "tank.soter"
    file.write_text(changed((TTF, "ttf true;")), encoding="utf-8")
    return file


def test_terminal_and_page_say_it_and_the_exit_code_stays(
    path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = path.with_suffix(".html")
    assert main(["verify", str(path), "--report", str(page)]) == 0
    out = capsys.readouterr().out
    (line,) = [x for x in out.splitlines() if x.startswith("SafeTank")]
    assert "PROVED, but AC never keeps control" in line
    html = page.read_text("utf-8")
    head = re.search(r"<h1>(.*?)</h1>", html, re.DOTALL)
    assert head is not None
    assert "but AC never keeps control" in head[1]
    assert '<span class="badge but">' in html
    assert '<span class="badge proved">✓ proved</span></h2>' not in html


def test_json_and_python_say_it(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["verify", str(path), "--json"]) == 0
    module = json.loads(capsys.readouterr().out)["modules"]["SafeTank"]
    assert module["verdict"] == "proved"
    assert module["vacuous"]["how_often"] == "never"
    assert "never keeps" in module["headline"]
    report = soter.load(path).verify()
    assert "never keeps" in repr(report)
    assert "never keeps" in repr(report.modules[0])
