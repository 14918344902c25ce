"""`soter.gym.ProtectedVector`: seeds in words, ends where releases are lost, plain instants."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import soter
from soter.gym import make_vec

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
CART = EXAMPLES / "wall" / "cart.soter"
CLIFF = EXAMPLES / "mountain_car" / "cliff.soter"
MS = 1_000_000


def cart(folder: Path, *, until: str, faults: str = "") -> soter.Program:
    path = folder / "cart.soter"
    said = f"faults {{ {faults} }} " if faults else ""
    path.write_text(CART.read_text().replace("until 30s;", f"{said}until {until};", 1))
    return soter.load(path)


@pytest.mark.parametrize(
    "seed", [1.5, [1.5, 2], [1, None], "a", "12", None.__class__, [[1, 2]], -1, [1, -1], [1], {}]
)
def test_a_seed_that_is_none_is_refused_in_words(seed: Any, tmp_path: Path) -> None:
    env = make_vec(cart(tmp_path, until="1s"), 2)
    with pytest.raises(soter.SoterError) as caught:
        env.reset(seed=seed)
    assert caught.value.diagnostics[0].code == "U001"
    assert "seed" in str(caught.value)


@pytest.mark.parametrize("seed", [3, np.int64(3), [3, 4], (3, 4), np.array([3, 4]), range(3, 5)])
def test_seeds_are_taken_as_they_come(seed: Any, tmp_path: Path) -> None:
    env = make_vec(cart(tmp_path, until="1s"), 2)
    env.reset(seed=seed)
    assert env.worlds.states.view(env.compiled.dtype)["header"]["seed"][:, 0].tolist() == [3, 4]


def ends(program: soter.Program, worlds: int, **how: Any) -> tuple[list[int], list[int]]:
    """When the first episode of each world is truncated, ms, and after how many steps."""
    env = make_vec(program, worlds, autoreset="Disabled", **how)
    env.reset(seed=1)
    actions = np.zeros((worlds, 1))
    times, steps = [0] * worlds, [0] * worlds
    for _ in range(2000):
        _, _, _, cut, info = env.step(actions)
        for k in np.flatnonzero(cut):
            times[k], steps[k] = int(info["time"][k]) // MS, int(info["steps"][k])
        if all(times):
            break
        if cut.any():
            env.reset(options={"reset_mask": cut})
    return times, steps


def test_an_episode_ends_with_the_system_also_where_the_agent_skips(tmp_path: Path) -> None:
    plain = cart(tmp_path, until="995ms")
    agent = plain.flat().component("SafeCart.Fast")
    last = 995 * MS // agent.period_ns * agent.period_ns // MS
    times, steps = ends(plain, 3)
    assert times == [last] * 3
    assert steps == [last * MS // agent.period_ns] * 3
    faulty = cart(tmp_path, until="995ms", faults="skip SafeCart.Fast at 5 per 1s;")
    times, steps = ends(faulty, 12)
    step = agent.period_ns // MS
    assert all(last <= t <= last + 20 * step for t in times)
    assert min(times) == last
    assert all(n < last // step for n in steps), "each of them skipped"
    times, steps = ends(faulty, 12, max_steps=last // step)
    assert steps == [last // step] * 12
    assert max(times) > last + step, "steps were asked for, steps are counted"


@pytest.mark.parametrize(("path", "system"), [(CLIFF, "RandomProtected"), (CART, None)])
def test_instants_of_plain_programs_are_those_of_the_kernel(path: Path, system: str | None) -> None:
    seen = []
    for plain in (1, 0):
        env = make_vec(path, 5, system=system, max_steps=70)
        assert env.compiled.view.plain == 1
        env.compiled.view.plain = plain
        try:
            env.reset(seed=11)
            rng, told = np.random.default_rng(2), []
            for _ in range(200):
                env.step(rng.uniform(-1.02, 1.02, (5, 1)))
                worlds = env.worlds
                told.append((worlds.states.tobytes(), worlds.facts.tobytes()))
            seen.append(told)
        finally:
            env.compiled.view.plain = 1
    assert seen[0] == seen[1]
