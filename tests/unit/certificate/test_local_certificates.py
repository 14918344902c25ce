"""Certificates of a cart with drag, and of SCs with locals: right ones and wrong ones."""

from __future__ import annotations

from collections import Counter
from contextlib import nullcontext
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from bench.recheck.corruptions import Sealed, judge, read
from bench.recheck.models import Attack, Cart

from soter.certificate.reading.case_model import CaseModel
from soter.certificate.rechecker import recheck
from soter.certificate.report import NotRecheckedError
from soter.certificate.terms.compile_terms import compile_step, form_of_box
from soter.certificate.terms.linear_enclosures import exact
from tables import all_rows
from unit.certificate import small_proofs

if TYPE_CHECKING:
    from pathlib import Path

DRAGGED = Cart(
    drag=0.3,
    cells_x=26,
    cells_v=22,
    late=1,
    age=10,
    wind=0.05,
    tau=0.2,
    tau_safer=0.3,
    e_x=0.005,
    e_v=0.01,
)


def certified(folder: Path, text: str, cells: tuple[int, int], holds_max: int = 12) -> Path:
    path = folder / "cart.soter"
    path.write_text(text)
    facts = small_proofs.facts_of(path, "Track", "SafeCart")
    made = small_proofs.prove(facts, (cells,), holds_max)
    made["entry"]["system"] = "Track"
    small_proofs.write(
        folder / "cert", {"cart.soter": text}, "cart.soter", [made["entry"]], made["sets"]
    )
    return folder / "cert"


@pytest.fixture(scope="module")
def dragged(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("dragged")
    cells = (DRAGGED.cells_x, DRAGGED.cells_v)
    return certified(folder, DRAGGED.text(), cells, holds_max=6)


@pytest.fixture(scope="module")
def base(dragged: Path) -> Sealed:
    return read(dragged, DRAGGED)


def test_a_cart_with_drag_is_accepted(dragged: Path, base: Sealed) -> None:
    report = recheck(dragged)
    assert report.accepted, report.reason
    assert report.safe
    assert report.has_return
    assert (base.tables["K"] > 0).sum() > 300
    assert (base.tables["R"] > 0).sum() > 200
    assert not Attack(DRAGGED, base.as_tables(), 1).broken({}, 5000)


def beyond(base: Sealed, name: str, draw: np.random.Generator) -> tuple[int, int]:
    """A cell next to a table and not in it."""
    members = base.tables[name] > 0
    near = np.zeros_like(members)
    near[1:] |= members[:-1]
    near[:-1] |= members[1:]
    near[:, 1:] |= members[:, :-1]
    near[:, :-1] |= members[:, 1:]
    cells = np.argwhere(near & ~members)
    i, j = cells[draw.integers(len(cells))]
    return int(i), int(j)


@pytest.mark.parametrize("name", ["K", "R", "Q"])
def test_one_more_cell_is_rejected(base: Sealed, tmp_path: Path, name: str) -> None:
    """Unless it is true, as far as runs can tell: the tables were made without halving."""
    draw = np.random.default_rng(len(name))
    rejected = 0
    for k in range(3):
        wrong = base.copy()
        cell = beyond(base, name, draw)
        wrong.tables[name][cell] = 1 if name == "R" else 3
        if name == "R":
            wrong.tables["K"][cell] = wrong.tables["K"][cell] or 3
        wrong.write(tmp_path / str(k))
        report = recheck(tmp_path / str(k))
        rejected += not report.accepted
        if report.accepted:
            suspects = {name: np.array([cell])}
            assert not Attack(DRAGGED, wrong.as_tables(), k).broken(suspects)
    assert rejected >= 2


@pytest.mark.long
def test_a_rank_too_low_is_rejected(base: Sealed, tmp_path: Path) -> None:
    wrong = base.copy()
    rank = wrong.tables["W"]
    far = np.argwhere(rank == rank.max())
    assert rank.max() > 2
    for i, j in far:
        rank[i, j] = 2
    wrong.write(tmp_path / "wrong")
    report = recheck(tmp_path / "wrong")
    assert not report.accepted
    assert "nearer to Q" in report.reason


@pytest.mark.long
def test_nothing_false_is_accepted_of_what_was_changed(base: Sealed) -> None:
    said: Counter[str] = Counter()
    for seed in range(500, 506):
        outcome = judge(base, seed)
        said["accepted" if outcome.accepted else "rejected"] += 1
        assert not (outcome.accepted and outcome.broken), outcome
    assert said["rejected"] > 2


# ---------------------------------------------------------------- locals

LAW = "step { publish accel = clamp(-2.0 * motion.x - 2.5 * motion.v, -A, A); }"
WITH_LOCALS = """var since: int in [0, 3] = 0;
  var braking: bool = false;
  var gear: Gear = Gear.Low;
  step {{
    {body}
    let gain = gear == Gear.High ? {high} : 1.0;
    publish accel = clamp(gain * (-2.0 * motion.x - 2.5 * motion.v), -A, A);
  }}"""
COUNTED = """since = min(since + 1, 3);
    let forwards = motion.v > 0.0;
    if forwards != braking {
      braking = forwards;
      since = 0;
      gear = Gear.Low;
    } elseif since == 3 {
      gear = Gear.High;
    }"""


def command_of(tmp_path: Path, body: str, high: str) -> Any:
    """What SC publishes on a box of states, whatever its locals are; None where it may fault."""
    cart = Cart()
    text = cart.text().replace("type Motion", "type Gear = enum { Low, High };\ntype Motion")
    assert LAW in text
    (tmp_path / "cart.soter").write_text(
        text.replace(LAW, WITH_LOCALS.format(body=body, high=high))
    )
    facts = small_proofs.facts_of(tmp_path / "cart.soter", "Track", "SafeCart")
    model = CaseModel(facts, (), tuple(facts.axes[i] for i in range(2)))
    terms, states = model.new_terms()
    (command,) = model.sc_commands(terms, states)
    places = [x.atom for x in states]
    step = compile_step(terms, places, 2, [command], ranges=[command], must=terms.obligations)

    def over(x: float, v: float, half: float) -> tuple[float, ...] | None:
        box = [(exact(x - half), exact(x + half)), (exact(v - half), exact(v + half))]
        image = step(form_of_box(box, symbols=True))
        return None if image is None else (*image[1], *(float(c) for c in image[0]))

    return over


def law(gain: float, x: float, v: float) -> float:
    return float(np.clip(gain * (-2.0 * x - 2.5 * v), -3.0, 3.0))


@pytest.mark.parametrize(
    ("body", "high", "gains"),
    [
        (COUNTED, "1.5", (1.0, 1.5)),
        ("gear = Gear.Low;", "-1.0", (1.0,)),  # the other gear never is in
        ("gear = since == 2 ? Gear.High : Gear.Low;", "-1.0", (1.0, -1.0)),
        ("if since > 0 && braking { gear = Gear.High; } else { gear = Gear.Low; }", "2", (1, 2)),
        ("since = min(since + 1, 3); braking = since > 1;", "0.5", (1.0, 0.5)),
        ("if since < 3 { since = since + 1; } gear = Gear.High;", "0.7", (0.7,)),
    ],
)
def test_locals_may_be_anything_in_every_step(
    tmp_path: Path, body: str, high: str, gains: tuple[float, ...]
) -> None:
    """Every value that some locals lead to lies in the enclosure, and hardly more."""
    if "." not in high:
        high += ".0"
    over = command_of(tmp_path, body, high)
    draw = np.random.default_rng(2)
    for _ in range(40):
        x, v = draw.uniform(-0.6, 0.6, 2)
        half = float(10.0 ** draw.uniform(-4, -1.5))
        low, top, _, _, centre, _, _, _ = over(x, v, half)
        values = []
        for gain in gains:
            for _ in range(6):
                e_x, e_v = draw.choice([-1, 1], 2) * (0.01, 0.02)
                at = x + draw.uniform(-half, half), v + draw.uniform(-half, half)
                values.append(law(gain, at[0] + e_x, at[1] + e_v))
        assert low <= min(values)
        assert max(values) <= top
        assert top - low <= max(values) - min(values) + 0.4
        assert low <= centre <= top


@pytest.mark.parametrize(
    ("body", "near", "far"),
    [
        ("since = since + 1;", None, None),
        ("assert since < 3;", None, None),
        ("if motion.v > 0.5 { assert !braking; }", True, None),
        ("if motion.v > 0.5 { since = since + 1; }", True, None),
        ("braking = motion.v > 0.5 && TWO[since] > 0;", True, None),
        ("braking = motion.v > 0.5 ? 6 / since > 0 : false;", True, None),
        ("if since < 3 { since = since + 1; }", True, True),
    ],
)
def test_a_fault_for_some_locals_is_a_fault(
    tmp_path: Path, body: str, near: bool | None, far: bool | None
) -> None:
    """Where it may be reached, and only there."""
    body = body.replace("TWO[since] > 0", "3 / since > 0")
    try:
        over = command_of(tmp_path, body, "1.0")
    except NotRecheckedError as error:
        assert "faults" in str(error)  # noqa: PT017
        assert near is None
        return
    assert (over(0.1, 0.1, 0.01) is None) == (near is None)
    assert (over(0.1, 0.9, 0.01) is None) == (far is None)


@all_rows(
    ("of", "refused"),
    [("bool", False), ("int in [0, 3]", False), ("int", True), ("float", True), ("Motion", True)],
)
def test_a_local_is_one_of_so_many_values(tmp_path: Path, of: str, refused: bool) -> None:
    """Of a float an entry may say a range; this one says none."""
    (tmp_path / "cart.soter").write_text(Cart().text().replace(LAW, f"var own: {of};\n  {LAW}"))
    facts = small_proofs.facts_of(tmp_path / "cart.soter", "Track", "SafeCart")
    model = CaseModel(facts, (), tuple(facts.axes[i] for i in range(2)))
    why = "a local that is no truth, enumeration or bounded int"
    with pytest.raises(NotRecheckedError, match=why) if refused else nullcontext():
        model.sc_commands(*model.new_terms())


def test_a_long_range_is_an_input(tmp_path: Path) -> None:
    """Too many values to be taken one by one."""
    over = command_of(tmp_path, "gear = since > 1 ? Gear.Low : Gear.High;", "1.5")
    wide = WITH_LOCALS.replace("[0, 3]", "[0, 100000]")
    (tmp_path / "wide").mkdir()
    text = Cart().text().replace("type Motion", "type Gear = enum { Low, High };\ntype Motion")
    body = "gear = since > 1 ? Gear.Low : Gear.High;"
    (tmp_path / "wide" / "cart.soter").write_text(
        text.replace(LAW, wide.format(body=body, high="1.5"))
    )
    facts = small_proofs.facts_of(tmp_path / "wide" / "cart.soter", "Track", "SafeCart")
    model = CaseModel(facts, (), tuple(facts.axes[i] for i in range(2)))
    terms, states = model.new_terms()
    (command,) = model.sc_commands(terms, states)
    places = [x.atom for x in states]
    step = compile_step(terms, places, 2, [command], ranges=[command], must=terms.obligations)
    box = [(exact(0.1), exact(0.11)), (exact(0.2), exact(0.21))]
    image = step(form_of_box(box, symbols=True))
    assert image is not None
    low, top = image[1]
    few = over(0.105, 0.205, 0.005)
    assert low <= few[0] + 1e-9
    assert top >= few[1] - 1e-9
