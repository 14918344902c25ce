"""Fair choices: nobody waits for ever, and no more is forbidden than that needs."""

from __future__ import annotations

from itertools import product

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from soter.language.evaluate.environment import MAX_FAIR, ages_after, allowed_picks


def windows_are_full(picks: list[int], count: int) -> bool:
    """Whether any 2n consecutive picks hold every alternative."""
    every = set(range(count))
    return all(set(picks[i : i + 2 * count]) == every for i in range(len(picks) - 2 * count + 1))


@settings(max_examples=200, deadline=None)
@given(st.integers(1, 12), st.data())
@pytest.mark.long
def test_every_alternative_comes_in_any_2n_executions(count: int, data: st.DataObject) -> None:
    ages: tuple[int, ...] = (0,) * count
    picks: list[int] = []
    for _ in range(6 * count):
        able = allowed_picks(ages)
        assert able == sorted(set(able)) != []
        picks.append(data.draw(st.sampled_from(able)))
        ages = ages_after(ages, picks[-1])
    assert windows_are_full(picks, count)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_what_is_not_allowed_would_have_to_break_the_promise(count: int) -> None:
    """Every sequence that keeps all windows full is possible: the rule forbids nothing else."""
    length = {1: 6, 2: 9, 3: 9}[count]
    ages: dict[tuple[int, ...], tuple[int, ...]] = {(): (0,) * count}
    for _ in range(length):
        ages = {
            (*picks, pick): ages_after(before, pick)
            for picks, before in ages.items()
            for pick in allowed_picks(before)
        }
    possible = set(ages)
    promised = {p for p in product(range(count), repeat=length) if windows_are_full(list(p), count)}
    assert possible <= promised
    unfinished = {p for p in promised - possible if not _can_go_on(p, count)}
    assert promised - possible == unfinished


def _can_go_on(picks: tuple[int, ...], count: int) -> bool:
    """Whether the picks can be continued for 2n more with every window full."""
    return any(
        windows_are_full([*picks, *more], count) for more in product(range(count), repeat=2 * count)
    )


@pytest.mark.parametrize("count", [2, 3, 8, MAX_FAIR])
def test_ages_fit_a_byte_and_are_used_to_the_end(count: int) -> None:
    ages: tuple[int, ...] = (0,) * count
    oldest = 0
    for _ in range(4 * count):
        ages = ages_after(ages, allowed_picks(ages)[0])
        oldest = max(oldest, *ages)
    assert oldest == 2 * count - 1 <= 255


def test_taking_one_makes_the_others_older() -> None:
    assert ages_after((3, 0, 2), 2) == (4, 1, 0)
    assert allowed_picks((0, 0)) == [0, 1]
    assert allowed_picks((0, 3)) == [1]
