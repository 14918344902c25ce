"""Find a safe controller: from a core and its commands to a table, from a table to Soter source.

Purpose: choose one command for every cell of a coarse table so that the law that reads it keeps
the core, and heads for where an adversary would need longest to do harm; then write the law as a
node. Nothing here is trusted: the written node is verified like any other.
Non-goals: the core and the images of cells (`verify/grid/sets.py`), proofs (`verify.py`).

A law that is read off a table is analysed on closed cells, so on a border all commands of the
neighbours may come. A cell is *free* when its image under every mixture of commands stays in the
core. All table entries that a cell which is not free can see must therefore agree.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from soter.verify.problem.problem import Problem

    Bools = NDArray[np.bool_]
    Floats = NDArray[np.float64]
    Ints = NDArray[np.int64]
    Read = Callable[[Floats], Floats]

NEVER = 1e6
"""Steps to the goal from where it is not reached."""
SWEEPS_MAX = 1000
GOAL_SHARE = 0.9
"""The goal of the law: blocks with at least this share of the longest time from harm."""
SEEN = 2
"""Cells around a cell whose table entries it may see: itself, a neighbour, and one for rounding."""
STRIDE = 8
"""Cells of the grid along each side of a block of the table."""


@dataclass(frozen=True)
class CellCommands:
    """What the engine says about the cells of a grid, shape (n_1, ..., n_d), and m commands."""

    core: Bools
    """K: from here some sequence of commands keeps the constraint for ever."""
    admits: Bools
    """(m, *cells): one period of the command leads back into K and never leaves C."""
    free: Bools
    """The same for every mixture of commands."""


@dataclass(frozen=True)
class LawTable:
    """A law: in block (i_1, ..., i_d) of equal blocks from `low` on, `width` each, this command."""

    low: tuple[float, ...]
    width: tuple[float, ...]
    entries: Ints


def block_middles(low: Sequence[float], width: Sequence[float], shape: tuple[int, ...]) -> Floats:
    """(*shape, d): the middles of equal blocks."""
    axes = [a + w * (np.arange(n) + 0.5) for a, w, n in zip(low, width, shape, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)


def chosen(
    choices: CellCommands,
    low: Sequence[float],
    width: Sequence[float],
    after: Callable[[int, Floats], Floats],
    stride: int = STRIDE,
) -> LawTable:
    """The table for a grid of equal cells from `low` on, `width` each.

    `after(u, points)`: where states (n, d) are one period of command u later, without disturbance.
    """
    admits = choices.admits & choices.core
    strict = choices.core & ~choices.free
    serves = strict & admits
    must = blocks(np.stack([_seen(s, SEEN) for s in serves]), stride)
    misses = blocks(np.stack([_seen(strict & ~s, SEEN) for s in serves]), stride)
    inside = blocks(choices.core[np.newaxis], stride)[0] > 0
    refused = blocks(choices.core & ~admits, stride) > 0
    refused &= ~refused.all(axis=0)
    sides = tuple(w * stride for w in width)
    points = block_middles(low, sides, inside.shape)
    flat = points.reshape(-1, points.shape[-1])
    moves = [
        _interpolation(low, sides, after(u, flat).reshape(points.shape), inside.shape)
        for u in range(len(admits))
    ]
    usual = _preferred(inside, refused, moves)
    popular = serves.reshape(len(serves), -1).sum(axis=1)  # breaks ties: neighbours then agree
    ranked = misses * (popular.max() + 1) - popular.reshape(-1, *[1] * strict.ndim)
    entries = np.where((must + misses).any(axis=0), ranked.argmin(axis=0), usual)
    return LawTable(tuple(low), sides, _spread(entries, inside | (must + misses).any(axis=0)))


def combinations(problem: Problem) -> list[tuple[float, ...]]:
    """Every command: the product of the finite sets of the controls, the last fastest."""
    return list(product(*problem.commands))


# ---------------------------------------------------------------- preferences


def _preferred(inside: Bools, refused: Bools, moves: Sequence[Read]) -> Ints:
    """Per block the command of least time to where an adversary needs longest to leave the core.

    Value iteration on the middles with multilinear interpolation: a guide, no proof.
    """
    start = np.where(inside, NEVER, 0.0)
    margin = _settled(
        start, lambda f: np.where(inside, 1.0 + np.min([m(f) for m in moves], axis=0), 0.0)
    )
    goal = inside & (margin >= GOAL_SHARE * np.where(inside, margin, 0.0).max())

    def costs(time: Floats) -> Floats:
        later = np.stack([np.minimum(1.0 + m(time), NEVER) for m in moves])
        return np.where(refused, NEVER, later)

    def better(time: Floats) -> Floats:
        return np.where(goal, 0.0, np.where(inside, costs(time).min(axis=0), NEVER))

    time = _settled(np.where(goal, 0.0, NEVER), better)
    gain = np.where(refused, -1.0, np.stack([m(margin) for m in moves]))
    best: Ints = np.where(goal, gain.argmax(axis=0), costs(time).argmin(axis=0))
    return best


def _settled(f: Floats, better: Callable[[Floats], Floats]) -> Floats:
    for _ in range(SWEEPS_MAX):
        following = better(f)
        moved = np.abs(following - f).max()
        f = following
        if moved < 1e-2:
            break
    return f


def _interpolation(
    low: Sequence[float], width: Sequence[float], points: Floats, shape: tuple[int, ...]
) -> Read:
    """Reads a function on the middles of blocks at points, held constant beyond the border."""
    firsts, shares = [], []
    for k, n in enumerate(shape):
        place = np.clip((points[..., k] - low[k]) / width[k] - 0.5, 0.0, n - 1.0)
        first = np.minimum(place.astype(np.int64), max(n - 2, 0))
        firsts.append(first)
        shares.append(place - first)
    indices, weights = [], []
    for corner in product((0, 1), repeat=len(shape)):
        picked = [np.minimum(f + c, n - 1) for f, c, n in zip(firsts, corner, shape, strict=True)]
        parts = [s if c else 1.0 - s for c, s in zip(corner, shares, strict=True)]
        indices.append(np.ravel_multi_index(picked, shape))
        weights.append(reduce(np.multiply, parts))
    where, weight = np.stack(indices), np.stack(weights)
    return lambda f: (weight * f.ravel()[where]).sum(axis=0)


# ---------------------------------------------------------------- blocks of cells


def _seen(cells: Bools, radius: int) -> Bools:
    """Everything within so many cells, diagonals included."""
    for axis in range(cells.ndim):
        grown = cells.copy()
        for step in range(1, radius + 1):
            ahead = [slice(None)] * cells.ndim
            behind = [slice(None)] * cells.ndim
            ahead[axis], behind[axis] = slice(step, None), slice(None, -step)
            grown[tuple(ahead)] |= cells[tuple(behind)]
            grown[tuple(behind)] |= cells[tuple(ahead)]
        cells = grown
    return cells


def blocks(votes: Bools, stride: int) -> Ints:
    """(m, *cells) -> (m, *blocks): how many cells of a block vote for each command."""
    count: Ints = votes.astype(np.int64)
    for axis in range(1, votes.ndim):
        starts = np.arange(0, votes.shape[axis], stride)
        summed: Ints = np.add.reduceat(count, starts, axis=axis)
        count = summed
    return count


def _spread(entries: Ints, known: Bools) -> Ints:
    """Entries with the unknown ones taken over from their neighbours, border by border."""
    result: Ints = entries.copy()
    left = ~known
    while left.any() and not left.all():
        for axis in range(entries.ndim):
            for step in (1, -1):
                source = np.roll(result, step, axis=axis)
                there = ~np.roll(left, step, axis=axis)
                edge = [slice(None)] * entries.ndim
                edge[axis] = slice(0, 1) if step == 1 else slice(-1, None)
                there[tuple(edge)] = False
                take = left & there
                result[take] = source[take]
                left &= ~take
    return result
