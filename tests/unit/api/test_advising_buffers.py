"""How far from the fence a DM takes over: as the compiled DM decides, and with room for SC."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from soter.api import load
from soter.api.buffer_advice import buffers
from soter.diagnostics.diagnostic import SoterError

if TYPE_CHECKING:
    from soter.api.buffer_advice import Buffers

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
CART = load(EXAMPLES / "wall" / "cart.soter")
LANE = (EXAMPLES / "rest" / "lane.soter").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def cart() -> Buffers:
    (found,) = buffers(CART)
    return found


def test_position_speed_and_fence_are_found(cart: Buffers) -> None:
    assert (cart.position, cart.speed, cart.units) == ("motion.x", "motion.v", ("m", "m/s"))
    assert cart.fence == pytest.approx(10.0, abs=1e-6)
    assert cart.fastest == pytest.approx(6.0, abs=1e-6), "AC may not be faster (`FAST`)"
    assert [r.speed for r in cart.rows] == pytest.approx(
        [cart.fastest * k / 8 for k in range(1, 9)]
    )


def test_sc_needs_what_its_brake_needs_and_has_room_for_more(cart: Buffers) -> None:
    for r in cart.rows:
        assert r.used == pytest.approx(r.speed**2 / 2 / 3.0, abs=0.01), "SC brakes with 3 m/s^2"
        assert r.used < r.room == pytest.approx(cart.fence - r.taken_at)
    rooms = [r.room for r in cart.rows]
    assert rooms == sorted(rooms)


def test_a_run_hands_over_where_the_table_says(cart: Buffers, tmp_path: Path) -> None:
    """AC drives to the wall: nowhere does it keep control nearer to it than the table says."""
    text = (EXAMPLES / "wall" / "cart.soter").read_text(encoding="utf-8")
    text = text.replace("publish accel = clamp(4.0 * (goal - motion.x) - 1.0 * motion.v, -A, A);",
                        "publish accel = motion.v < 4.5 ? A : 0.0;")  # fmt: skip
    (tmp_path / "wall.soter").write_text(text, encoding="utf-8")
    run = load(tmp_path / "wall.soter").simulate("Protected", until="20s", trace=True)
    x, v, mode = run.array("motion.x"), run.array("motion.v"), run.mode("SafeCart")
    taken = [(x[k], v[k]) for k in range(1, len(x)) if mode[k - 1] == 1 and mode[k] == 0]
    taken = [(at, speed) for at, speed in taken if speed > cart.rows[0].speed]
    assert taken
    speeds, places = ([getattr(r, n) for r in cart.rows] for n in ("speed", "taken_at"))
    for at, speed in taken:
        late = at - np.interp(speed, speeds, places)
        assert -0.1 < late < 0.05 * speed + 0.1, "at the first look behind it, of 50 ms"


def test_what_is_named_wrongly_is_told() -> None:
    with pytest.raises(SoterError, match="shows no state"):
        buffers(CART, ("motion.y", "motion.v"))
    with pytest.raises(SoterError, match="has no module `nosuch`"):
        buffers(CART, module="nosuch")
    with pytest.raises(SoterError, match="has no end"):
        buffers(CART, ("motion.v", "motion.x"))


@pytest.mark.long
def test_passive_safety_ends_where_a_moving_robot_would_touch() -> None:
    """`safe` holds everywhere at rest, so its end is asked for at a speed."""
    (found,) = buffers(load(EXAMPLES / "migration" / "zone_size.soter"))
    assert found.fence == pytest.approx(0.3, abs=1e-6)
    assert [r.room for r in found.rows] == sorted(r.room for r in found.rows)
    assert found.rows[-1].room > found.rows[-1].used + 1.0, "somebody walks up at 1 m/s meanwhile"
    zones = {0.3: 1.5, 0.6: 2.1, 1.0: 2.6}  # of docs/migrating.md and the program
    for speed, zone in zones.items():
        assert next(r.taken_at for r in found.rows if r.speed >= speed) < zone
