"""What counts as evidence: what was judged, flights that differ, the hours of a bound, excuses."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from json_documents import problems_of
from soter import SoterError, load
from soter.campaign.batch_flights import Fleet
from soter.campaign.result import faults_outside
from soter.campaign.statistics import FLIGHTS, POISSON, clopper_pearson_interval, garwood_interval
from soter.diagnostics.diagnostic import Severity
from soter.language.elaborate.derived_systems import without_outside_faults
from soter.language.front_end import check_file, system_of
from unit.diagnostics.page_examples import mended, wrong

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.campaign.result import Campaign

ROOT = Path(__file__).resolve().parents[3]
CART = ROOT / "examples" / "wall" / "cart.soter"
SECOND = 10**9
WALK = """soter 1;
topic u: float in [-1.0, 1.0];
plant Car period 10ms {{ reads u; state x: float = 0.0; der x = u; }}
node Driver period 100ms {{ publishes u; step {{ publish u = {drive}; }} }}
system Road {{ car: Car; node Driver; until 2s; {says} }}
"""
CHANCE, SAME = "choose [0, 1] == 0 ? 0.5 : -0.5", "0.5"
FAR = "always abs(car.truth.x) < 9.0;"
ALOFT = "measure aloft = car.truth.x > 0.0 ? 1.0 : 0.0 in [0.0, 1.0] / 2 every 100ms;"


@pytest.fixture
def flown(tmp_path: Path) -> Callable[..., Campaign]:
    def fly(drive: str, says: str, **how: Any) -> Campaign:
        path = tmp_path / "walk.soter"
        path.write_text(WALK.format(drive=drive, says=says))
        return load(path).campaign(**{"flights": 60, "output": tmp_path / "c", **how})

    return fly


def faulty(folder: Path, faults: str, name: str = "faulty.soter") -> Path:
    text = CART.read_text(encoding="utf-8")
    head, tail = text.split("system Protected", 1)
    tail = tail.replace("until 30s;", f"until 30s;\n  faults {{ {faults} }}", 1)
    path = folder / name
    path.write_text(f"{head}system Protected{tail}")
    return path


# ---------------------------------------------------------------- what was judged


def test_a_system_that_says_nothing_is_not_flown(
    flown: Callable[..., Campaign], tmp_path: Path
) -> None:
    with pytest.raises(SoterError, match="no property") as caught:
        flown(CHANCE, "")
    assert [d.code for d in caught.value.diagnostics] == ["C006"]
    assert not (tmp_path / "c").exists()


def test_the_page_of_c006_says_the_truth(tmp_path: Path) -> None:
    for text, codes in ((wrong("C006"), ["C006"]), (mended("C006"), [])):
        path = tmp_path / f"{len(codes)}.soter"
        path.write_text(text)
        try:
            load(path).campaign(flights=3, output=tmp_path / "c")
            said = list[str]()
        except SoterError as error:
            said = [d.code for d in error.diagnostics]
        assert said == codes


def test_a_system_that_only_measures_is_judged_by_nothing_and_says_so(
    flown: Callable[..., Campaign], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from soter.cli.main import main

    campaign = flown(CHANCE, ALOFT)
    (warning,) = campaign.diagnostics
    assert (warning.code, warning.severity) == ("C006", Severity.WARNING)
    assert campaign.result.per_hour == (0.0, float("inf"))
    assert campaign.result.per_flight == (0.0, 1.0)
    asked = ["campaign", str(tmp_path / "walk.soter"), "--flights", "60", "-o", str(tmp_path / "c")]
    assert main([*asked, "--report"]) == 0
    said = capsys.readouterr()
    assert "nothing was judged" in said.out
    assert "0 violations" not in said.out + (tmp_path / "c" / "report.html").read_text()
    assert "C006" in said.err
    assert main([*asked, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert problems_of(document) == []
    assert document["properties"] == 0
    assert document["violations_per_hour"] == [0.0, None]
    assert [d["code"] for d in document["diagnostics"]] == ["C006"]


@pytest.mark.parametrize(
    ("says", "idle"),
    [
        ("always true;", True),
        ("always u - u < 0.5;", True),
        ("never u > 1.0;", True),  # its set ends there
        ("never u > 0.9;", False),  # no flight does, and one could
        (FAR, False),
    ],
)
def test_a_property_that_no_flight_can_violate_is_said(
    flown: Callable[..., Campaign], says: str, idle: bool
) -> None:
    campaign = flown(CHANCE, says, flights=20)
    told = [d for d in campaign.diagnostics if d.code == "C006"]
    assert [d.severity for d in told] == [Severity.WARNING] * idle
    assert all(f"no flight can violate `{says[:-1]}`" in d.message for d in told)


# ---------------------------------------------------------------- copies


def test_copies_of_one_flight_are_one(
    flown: Callable[..., Campaign], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from soter.cli.main import main

    campaign = flown(SAME, FAR)
    r = campaign.result
    assert (r.flights, r.distinct) == (60, 1)
    assert r.per_hour == pytest.approx(garwood_interval(0, 2 / 3600))
    assert r.per_flight == clopper_pearson_interval(0, 1)
    (warning,) = campaign.diagnostics
    assert (warning.code, warning.severity) == ("C007", Severity.WARNING)
    assert "60 flights are copies of one" in warning.message
    asked = ["campaign", str(tmp_path / "walk.soter"), "--flights", "60", "-o", str(tmp_path / "c")]
    assert main([*asked, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert problems_of(document) == []
    assert document["distinct_flights"] == 1
    assert document["violations_per_hour"] == list(r.per_hour)
    with (campaign.folder / "flights.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len({row["trajectory"] for row in rows}) == 1
    assert len({row["digest"] for row in rows}) == 60


def test_flights_that_differ_are_all_counted(flown: Callable[..., Campaign]) -> None:
    campaign = flown(CHANCE, FAR)
    assert campaign.result.distinct == 60
    assert campaign.diagnostics == ()
    assert campaign.result.per_hour == garwood_interval(0, 120 / 3600)


def test_flights_that_end_alike_are_no_copies(tmp_path: Path) -> None:
    """No event, and the same last state: what happened in between is not the same."""
    path = tmp_path / "p.soter"
    path.write_text(
        "soter 1; plant P period 10ms { state n: int in [0, 9] = 0; state k: int in [0, 999] = 0;\n"
        "  disturbance w: float in [-1.0, 1.0];\n"
        "  next k = (k + 1) % 1000; next n = k < 90 && w > 0.0 ? 5 : 0; }\n"
        "system S { p: P; until 1s; always p.truth.n < 9; }"
    )
    campaign = load(path).campaign(flights=8, output=tmp_path / "c")
    assert campaign.result.distinct == 8


# ---------------------------------------------------------------- hours, scatter


def test_a_bound_is_over_the_hours_of_the_headline(
    flown: Callable[..., Campaign], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from soter.cli.main import main

    r = flown(CHANCE, FAR + ALOFT).result
    assert r.hours_aloft is not None
    assert 0.0 < r.hours_aloft < r.hours
    assert r.per_hour == pytest.approx(garwood_interval(0, r.hours_aloft))
    asked = ["campaign", str(tmp_path / "walk.soter"), "--flights", "60", "-o", str(tmp_path / "c")]
    main(asked)
    said = capsys.readouterr().out
    assert f"less than {r.per_hour[1]:.3g} an hour aloft" in said
    main([*asked, "--json", "--report"])
    document = json.loads(capsys.readouterr().out)
    assert problems_of(document) == []
    assert document["hours_of"] == "aloft"
    assert document["violations_per_hour"][1] == pytest.approx(
        garwood_interval(0, document["hours"])[1]
    )
    page = (tmp_path / "c" / "report.html").read_text()
    assert f"less than {r.per_hour[1]:.3g} violations an hour aloft" in page


def test_aloft_is_a_share_of_the_time_whatever_it_measures(flown: Callable[..., Campaign]) -> None:
    often = ALOFT.replace("1.0 : 0.0", "50.0 : -50.0")
    r = flown(CHANCE, FAR + often).result
    assert r.hours_aloft is not None
    assert 0.0 <= r.hours_aloft <= r.hours


def test_episodes_that_do_not_scatter_are_bounded_by_flight(tmp_path: Path) -> None:
    campaign = load(CART).campaign("Protected", flights=200, until="30s", output=tmp_path / "c")
    (module,) = campaign.result.modules
    assert (module.episodes, module.basis) == (200, FLIGHTS)
    low, high = module.per_hour
    assert 110 < low < 120 < garwood_interval(200, campaign.result.hours)[1] < high


def test_violations_that_scatter_as_poisson_keep_their_exact_interval(tmp_path: Path) -> None:
    faults = "late SafeCart.dm by 900ms at 200 per 1h;"
    path = faulty(tmp_path, faults)
    r = load(path).campaign("Protected", flights=60, until="20s", output=tmp_path / "c").result
    assert 0 < r.flights_violated < 60
    assert r.per_hour_basis == POISSON
    assert r.per_hour == pytest.approx(garwood_interval(r.violations, r.hours))


# ---------------------------------------------------------------- excuses

LATE = "late SafeCart.dm by 900ms at 1000 per 1h;"
HIGH = "always c.truth.v < 1.0;"


def test_a_fault_outside_excuses_only_what_is_clean_without_it(tmp_path: Path) -> None:
    """AC drives faster than 1 m/s whatever happens: no lateness of a DM is to blame for that."""
    path = faulty(tmp_path, LATE)
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("always Clear(c.truth);", f"always Clear(c.truth); {HIGH}", 1))
    r = load(path).campaign("Protected", flights=40, until="20s", output=tmp_path / "c").result
    flat = system_of(check_file(str(path)), "Protected")
    met = [f for f in r.worst if faults_outside(flat, f.seed, round((f.first_s or 0.0) * 1e9))]
    assert met
    assert r.flights_violated == r.violated_inside == 40
    assert all(b.clean_without is False for b in r.blames if b.met)


def test_what_a_fault_outside_made_is_told_of_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from soter.cli.main import main

    path = faulty(tmp_path, f"{LATE} skip SafeCart.Careful at 300 per 1h;")
    asked = ["campaign", str(path), "--system", "Protected", "--flights", "40", "--until", "20s"]
    asked += ["-o", str(tmp_path / "c")]
    assert main([*asked, "--json", "--report"]) == 3
    document = json.loads(capsys.readouterr().out)
    assert problems_of(document) == []
    violated = document["flights_violated"]
    assert violated == document["violated_outside"] > 0 == document["violated_inside"]
    assert all(f["clean_without"] is True for f in document["violated_flights"])
    told = document["excused"][LATE.rstrip(";")]
    assert violated == told["met"] >= told["flights"] > 0
    assert main(asked) == 3
    said = capsys.readouterr().out
    assert f"{violated} of them are clean when they are flown again without" in said
    page = (tmp_path / "c" / "report.html").read_text(encoding="utf-8")
    assert f"{violated} of them are clean when they are flown again without" in page


def test_without_what_is_outside_a_flight_is_that_of_the_system_that_never_had_it(
    tmp_path: Path,
) -> None:
    inside = "stuck SafeCart.Fast at 400 per 1h for 1s;"
    more = (
        f"{LATE} {inside} order any; late all by 2ms; overrun SafeCart.Fast by 35ms at 60 per 1h;"
    )
    both = system_of(check_file(str(faulty(tmp_path, more))), "Protected")
    alone = system_of(check_file(str(faulty(tmp_path, inside, "inside.soter"))), "Protected")
    left = without_outside_faults(both)
    assert not left.shuffled
    assert not [f for f in left.faults if f.inside is None]
    got = Fleet(left, 10 * SECOND).fly(range(12), first_seed=1)
    wanted = Fleet(alone, 10 * SECOND).fly(range(12), first_seed=1)
    assert [(f.ac_s, f.first_s, f.episodes) for f in got] == [
        (f.ac_s, f.first_s, f.episodes) for f in wanted
    ]


def test_arms_are_judged_the_same_way(tmp_path: Path) -> None:
    how = {"flights": 20, "until": "20s", "output": tmp_path / "c"}
    campaign = load(CART).campaign("Protected", arms=("ac", "swept"), **how)
    alone = next(a.result for a in campaign.arms if a.name == "ac")
    assert alone.flights_violated == alone.violated_inside > 0, "no fault is to blame"
    swept = [a.result for a in campaign.arms if "1200ms" in a.name]
    assert all(r.violated_inside == 0 for r in swept)


def test_a_campaign_that_goes_on_says_the_same_of_its_violations(tmp_path: Path) -> None:
    path = faulty(tmp_path, LATE)
    how = {"until": "20s", "output": tmp_path / "c"}
    load(path).campaign("Protected", flights=15, **how)
    on = load(path).campaign("Protected", flights=40, **how)
    whole = load(path).campaign("Protected", flights=40, until="20s", output=tmp_path / "w")
    assert on.result == whole.result
    assert load(path).campaign("Protected", flights=40, **how).result == whole.result


# ---------------------------------------------------------------- what cannot be told


def test_a_measure_without_numbers_tells_nothing(
    flown: Callable[..., Campaign], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from soter.cli.main import main

    never = "1.0 / (car.truth.x > 100.0 ? 1.0 : 0.0) in [0.0, 1.0] / 2 every 100ms;"
    campaign = flown(CHANCE, f"{FAR} measure speed = {never} measure aloft = {never}", flights=5)
    assert (campaign.result.km, campaign.result.hours_aloft) == (None, 0.0)
    asked = ["campaign", str(tmp_path / "walk.soter"), "--flights", "5", "-o", str(tmp_path / "c")]
    assert main([*asked, "--json", "--report"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert problems_of(document) == []
    assert (document["km"], document["hours"]) == (None, 0.0)
    assert document["violations_per_hour"] == [0.0, None]
    assert main(asked) == 0
    said = capsys.readouterr().out
    assert (
        f"less than {100 * clopper_pearson_interval(0, 5)[1]:.3g} % of the flights are violated"
        in said
    )
    assert "nan km" not in said


def test_flights_that_are_violated_at_once_are_bounded(flown: Callable[..., Campaign]) -> None:
    r = flown(CHANCE, "always car.truth.x > 5.0;", flights=12).result
    assert (r.violations, r.flights_violated, r.violated_inside) == (12, 12, 12)
    assert r.per_flight == pytest.approx(clopper_pearson_interval(12, 12))
    one = flown(CHANCE, "always car.truth.x > 5.0;", flights=1).result  # of the same folder
    assert one.per_flight == pytest.approx(clopper_pearson_interval(1, 1))
    assert one.per_hour_basis == FLIGHTS
    assert one.per_hour[0] < 1800 < one.per_hour[1]


def test_faults_that_never_and_always_happen_are_counted_as_they_do(
    flown: Callable[..., Campaign],
) -> None:
    never = (
        f"{FAR} faults {{ stuck Driver at 0 per 1h for 1s; nan Driver at 36000 per 1h for 100ms; }}"
    )
    campaign = flown(CHANCE, never, flights=6)
    counts = dict(campaign.occurred)
    assert counts["stuck Driver at 0 per 1h for 1s"] == 0
    assert (counts["nan Driver at 36000 per 1h for 100ms"] or 0) >= 6 * 20
    assert campaign.result.excused == (("nan Driver at 36000 per 1h for 100ms", 6, 6),)


# ---------------------------------------------------------------- which of several


def test_a_fault_that_does_no_harm_excuses_nothing_by_being_there(
    flown: Callable[..., Campaign], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from soter.cli.main import main

    culprit = "nan Driver at 36000 per 1h for 100ms"
    campaign = flown(CHANCE, f"{FAR} faults {{ {culprit}; order any; }}", flights=6)
    assert campaign.result.violated_inside == 0
    assert all(set(b.met) == {"order any", culprit} for b in campaign.result.blames)
    assert all(b.needed == (culprit,) for b in campaign.result.blames)
    assert {t: (n, met) for t, n, met in campaign.result.excused} == {
        culprit: (6, 6),
        "order any": (0, 6),
    }
    asked = ["campaign", str(tmp_path / "walk.soter"), "--flights", "6", "-o", str(tmp_path / "c")]
    main([*asked, "--json"])
    document = json.loads(capsys.readouterr().out)
    assert problems_of(document) == []
    assert [f["needed"] for f in document["violated_flights"]] == [[culprit]] * 6
    main(asked)
    assert "6 of 6" in capsys.readouterr().out


def test_either_of_two_that_do_the_same_harm_is_not_enough(flown: Callable[..., Campaign]) -> None:
    """Without one of them the other one still latches the driver: only both together excuse."""
    both = "nan Driver at 36000 per 1h for 100ms; nan Driver at 18000 per 1h for 200ms;"
    r = flown(CHANCE, f"{FAR} faults {{ {both} }}", flights=6).result
    assert r.violated_inside == 0
    assert all(b.needed == () for b in r.blames)
    assert [n for _, n, _ in r.excused] == [0, 0]
