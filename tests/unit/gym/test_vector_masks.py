"""Masks of many worlds, and worlds of a module that protects nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import soter
from soter.gym import make_vec
from unit.gym.gym_cart import CART, ROOT
from unit.gym.test_protected import shielded

if TYPE_CHECKING:
    from pathlib import Path

THROTTLES = np.linspace(-3.0, 3.0, 7)[:, None]
FOLLOW = ROOT / "examples" / "evidence" / "follow.soter"


@pytest.mark.parametrize("shield", ["shield 8;", "shield 8 toward sc;"])
def test_masks_say_of_each_world_what_would_be_published_as_it_is(
    shield: str, tmp_path: Path
) -> None:
    """Each action is tried in worlds that came there alike."""
    path = shielded(tmp_path, shield)
    worlds = make_vec(path, 14, actions=THROTTLES, max_steps=0)
    worlds.reset(seed=[3] * 7 + [4] * 7)
    seen = set()
    for k in range(400):
        masks = worlds.action_masks()
        assert masks.dtype == np.bool_
        assert masks.shape == (14, 7)
        assert (masks[:7] == masks[0]).all()
        seen.add(tuple(masks[0].tolist()))
        if k % 40 == 39:
            *_, info = worlds.step(np.arange(14) % 7)
            free = masks[np.arange(14), np.arange(14) % 7]
            in_control = info["taken_by"]
            assert (info["intervened"] == ~free)[in_control].all()
            assert (info["action_requested"][:, 0] == np.tile(THROTTLES[:, 0], 2)).all()
            worlds.reset(seed=[3] * 7 + [4] * 7)
            for _ in range(3 * k):
                worlds.step(np.full(14, 6))
        worlds.step(np.full(14, 6))
    assert len(seen) > 2


def test_masks_are_of_an_agent_in_control(tmp_path: Path) -> None:
    """SC, which has control for ever, is at the middle; a forced module refuses nothing."""
    path = shielded(tmp_path, "shield 8 toward sc;")
    held = "\nsystem Held { c: Cart; module SafeCart; force SafeCart sc; until 30s; }\n"
    path.write_text(path.read_text("utf-8") + held, "utf-8")
    worlds = make_vec(path, 2, system="Held", actions=THROTTLES)
    _, info = worlds.reset(seed=1)
    assert not info["mode"].any()
    assert worlds.action_masks().all()


def test_only_numbers_of_rows_are_actions_of_a_choice() -> None:
    worlds = make_vec(CART, 2, actions=THROTTLES)
    worlds.reset(seed=1)
    assert worlds.action_masks().all()
    wrong: tuple[Any, ...] = ([0, 7], [-1, 0], [0.0, 1.0], [[0], [1]], [0])
    for actions in wrong:
        with pytest.raises(soter.SoterError, match="rows"):
            worlds.step(np.array(actions))
    with pytest.raises(soter.SoterError, match="`Discrete`"):
        make_vec(CART, 2).action_masks()
    with pytest.raises(soter.SoterError, match="shape"):
        make_vec(CART, 2, actions=[[1.0, 2.0]])


def test_a_module_with_rest_that_is_forced_to_ac_is_not_asked_and_flies_alike(
    tmp_path: Path,
) -> None:
    """Its DM would say `ttf` where the train is about to hit what stands."""
    path = tmp_path / "alone.soter"
    text = FOLLOW.read_text(encoding="utf-8")
    path.write_text(text.replace("  module Follow;\n", "  module Follow;\n  force Follow ac;\n"))
    run = soter.load(path).simulate(seed=5, until="12s", engine="native")
    worlds = make_vec(path, 1, observe=["r.truth"], max_steps=0)
    seen, info = worlds.reset(seed=5)
    at_ns = run.require_trace()["header"]["ct"]
    ways = []
    for _ in range(500):
        sight = run.array("sight.v"), run.array("sight.gap")
        k = int(np.searchsorted(at_ns, info["time"][0]))
        v, gap = (x[k] for x in sight)
        wanted = 0.5 * (30.0 - v) + 0.1 * (gap - 40.0)
        ways.append(seen[0, 1] == run.truth("r")["way"][k])
        seen, *_, info = worlds.step(np.clip([[wanted, -wanted]], 0.0, 1.0))
        assert not info["ttf"][0]
    assert all(ways)
    assert run.require_trace()["modules"]["ttf"].any()
