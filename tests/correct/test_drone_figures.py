"""The learned controller of the figure eight, and the paper's figures, each from one command."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from soter.api import load

if TYPE_CHECKING:
    from collections.abc import Iterator

DRONE = Path(__file__).resolve().parents[2] / "examples" / "drone"
EIGHT = DRONE / "eight.soter"


@pytest.fixture
def drone(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The example's own modules can be imported."""
    monkeypatch.syspath_prepend(str(DRONE))
    yield
    for name in ("figures", "eight_train", "sketch"):
        sys.modules.pop(name, None)


def vector(v: Any) -> dict[str, float]:
    return dict(zip("xyz", map(float, v), strict=True))


# ---------------------------------------------------------------- the network


@pytest.mark.usefixtures("drone")
def test_the_program_computes_the_network_that_was_trained() -> None:
    import json

    import eight_train as train

    table = json.loads(train.WEIGHTS.read_text(encoding="utf-8"))
    w = {k: np.array(table[k]) for k in ("hidden", "output", "bias")}
    asked = load(EIGHT).function("Asked")
    rng = np.random.default_rng(4)
    for _ in range(5):
        p, v, a, at, moving = rng.normal(0.0, 0.4, (5, 3))
        loop = {"active": True, "pace": 0.5, "p": vector(p), "v": vector(v), "a": vector(a)}
        u = asked(loop, {"p": vector(at), "v": vector(moving)})
        seen = np.concatenate([p - at, v - moving, a, [1.0]])[np.newaxis]
        bounds = np.array([4.15, 4.15, 1.8])
        expected = np.clip(train.answer(w, seen)[0], -bounds, bounds)
        assert np.allclose([u.x, u.y, u.z], expected, atol=1e-12)


@pytest.mark.usefixtures("drone")
def test_the_gradient_is_that_of_the_error() -> None:
    import eight_train as train

    rng = np.random.default_rng(2)
    w = {
        "hidden": rng.normal(size=(4, 10)),
        "output": rng.normal(size=(3, 4)),
        "bias": rng.normal(size=3),
    }
    seen, asked = rng.normal(size=(7, 10)), rng.normal(size=(7, 3))

    def error() -> float:
        return float(((train.answer(w, seen) - asked) ** 2).sum() / len(seen))

    slopes = train.gradient(w, seen, asked)
    for name, at in (("hidden", (1, 3)), ("output", (2, 1)), ("bias", (0,))):
        before = w[name][at]
        ends = []
        for step in (1e-5, -1e-5):
            w[name][at] = before + step
            ends.append(error())
        w[name][at] = before
        assert slopes[name][at] == pytest.approx((ends[0] - ends[1]) / 2e-5, rel=1e-5)


@pytest.mark.usefixtures("drone")
def test_training_imitates_and_equal_seeds_give_equal_weights(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    import eight_train as train

    monkeypatch.setattr(train, "LESSONS", 1)
    monkeypatch.setattr(train, "ROUNDS", 400)
    seen, asked = train.lessons(load(EIGHT), 1)
    assert seen.shape == (len(asked), 10)
    once, again, other = (train.fit(seen, asked, s) for s in (3, 3, 4))
    assert all(np.array_equal(once[k], again[k]) for k in once)
    assert not np.array_equal(once["hidden"], other["hidden"])
    miss = np.sqrt(np.mean((train.answer(once, seen) - asked) ** 2))
    assert miss < 0.3 * np.sqrt(np.mean(asked**2))


# ---------------------------------------------------------------- its flights


@pytest.mark.usefixtures("drone")
def test_the_network_follows_slow_loops_fails_on_fast_ones_and_hits_nothing_when_protected() -> (
    None
):
    import figures

    program = load(EIGHT)
    slow, fast = figures.eight(program, "LearnedAlone", (1, 6))
    assert slow.pace < 0.6
    assert slow.off_m < figures.CLOSE_M
    assert not slow.hit
    assert fast.pace > 1.0
    assert fast.off_m > 2 * figures.CLOSE_M
    assert fast.hit
    (safe,) = figures.eight(program, "LearnedProtected", (6,))
    assert safe.pace == fast.pace
    assert not safe.hit
    assert 0.9 < safe.ac_share < 1.0


# ---------------------------------------------------------------- the commands


@pytest.mark.usefixtures("drone")
@pytest.mark.parametrize(
    "name", ["5", "12a", *(pytest.param(n, marks=pytest.mark.long) for n in ("12b", "12c"))]
)
def test_each_figure_is_a_page_with_the_numbers_that_were_printed(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    import figures

    monkeypatch.setattr(figures, "FLIGHTS", 2)
    monkeypatch.setattr(figures, "LAPS", 3)
    file = tmp_path / "figure.html"
    monkeypatch.setattr(sys, "argv", ["figures.py", name, "-o", str(file)])
    figures.main()
    page = file.read_text(encoding="utf-8")
    assert "http" not in page.replace("http-equiv", "")
    assert "The paper&#x27;s" in page or "The paper's" in page
    assert page.count("<path d=") > 10
    lines = capsys.readouterr().out.splitlines()[1:-1]
    assert len(lines) > 5
    for line in lines:
        what, ours = re.split(r" {2,}", line.strip(), maxsplit=1)
        told = re.sub(r" +\(the paper: .*\)$", "", ours)
        row = re.search(
            rf'<th scope="row">{re.escape(what)}</th><td><strong>([^<]*)</strong>', page
        )
        assert row is not None, what
        assert row[1] == told


@pytest.mark.usefixtures("drone")
def test_a_figure_that_the_paper_does_not_have_is_refused(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    import figures

    monkeypatch.setattr(sys, "argv", ["figures.py", "13"])
    with pytest.raises(SystemExit) as stopped:
        figures.main()
    assert stopped.value.code == 2
    assert "12c" in capsys.readouterr().err


@pytest.mark.usefixtures("drone")
def test_a_panel_is_true_to_scale_with_round_ticks() -> None:
    import sketch

    panel = sketch.Panel((10.0, 30.0), (5.0, 25.0))
    (x0, y0), (x1, y1) = panel.place(12.0, 7.0), panel.place(13.0, 8.0)
    assert x1 - x0 == pytest.approx(y0 - y1)
    assert sketch.ticks(10.4, 30.6) == [15.0, 20.0, 25.0, 30.0]
    assert sketch.ticks(0.0, 600.0) == [0.0, 100.0, 200.0, 300.0, 400.0, 500.0, 600.0]
