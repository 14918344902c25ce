"""Makes a synthesized safe controller: its table of commands, and its text as a node of Soter.

Purpose: `block_law` picks one command for every block of a coarse table so that the law that reads
it keeps the core, and heads for where an adversary would need longest to do harm.
`program_with_law` makes the program with that law as a node in the place of `sc synthesized period
d;`. Nothing here is trusted: the written node is verified like any other.
Non-goals: the core and the images of cells (`verify/grid/sets.py`), proofs (`verify_module.py`).

The law is analysed on closed cells, so on a border all commands of the neighbours are possible. A
cell is *free* if its image under every mixture of commands stays in the core. So all table entries
that are possible in a cell which is not free have to agree.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from functools import reduce
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from soter.diagnostics.diagnostic import Diagnostics, Source
from soter.language.elaborate.derived_systems import unused_name
from soter.language.model.types import ArrayType, FloatType, RecordType, leaves
from soter.language.syntax.printer import format_source
from soter.report.atomic_write import path_without_links

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from soter.core.layout import Bools, Floats
    from soter.language.model.typed import ModuleSymbol, TopicSymbol
    from soter.language.model.types import Type
    from soter.verify.problem.problem import Problem

    Ints = NDArray[np.int64]
    Read = Callable[[Floats], Floats]


NEVER = 1e6
"""The number of steps to the goal where the goal is not reached."""
SWEEPS_MAX = 1000
GOAL_SHARE = 0.9
"""The goal of the law: blocks with at least this share of the longest time from harm."""
SEEN = 2
"""The number of cells from a state to a table entry that it may read: one, and one by rounding."""
STRIDE = 8
"""The number of cells of the grid along each side of a block of the table."""


@dataclass(frozen=True)
class CellCommands:
    """The sets that the engine computed for m commands on a grid of shape (n_1, ..., n_d)."""

    core: Bools
    """K: cells from which some sequence of commands keeps the constraint for ever."""
    admits: Bools
    """Truths (m, *cells): whether one period of a command leads back into K and never leaves C."""
    free: Bools
    """Cells from which one period of every mixture of commands does so."""


@dataclass(frozen=True)
class LawTable:
    """A law: a command's number for each block (i_1, ..., i_d) from `low` on, each `width` wide."""

    low: tuple[float, ...]
    width: tuple[float, ...]
    entries: Ints


def block_middles(low: Sequence[float], width: Sequence[float], shape: tuple[int, ...]) -> Floats:
    """The middles of equal blocks that begin at `low`, of shape (*shape, d)."""
    axes = [a + w * (np.arange(n) + 0.5) for a, w, n in zip(low, width, shape, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)


def block_law(
    choices: CellCommands,
    low: Sequence[float],
    width: Sequence[float],
    points_after: Callable[[int, Floats], Floats],
    stride: int = STRIDE,
) -> LawTable:
    """The law for a grid of equal cells, which begin at `low` and are `width` wide.

    `points_after(u, points)` gives the undisturbed states (n, d) after one period of command u.
    """
    admits = choices.admits & choices.core
    strict = choices.core & ~choices.free
    serves = strict & admits
    must = votes_by_block(np.stack([_cells_within(s, SEEN) for s in serves]), stride)
    misses = votes_by_block(np.stack([_cells_within(strict & ~s, SEEN) for s in serves]), stride)
    inside = votes_by_block(choices.core[np.newaxis], stride)[0] > 0
    refused = votes_by_block(choices.core & ~admits, stride) > 0
    refused &= ~refused.all(axis=0)
    sides = tuple(w * stride for w in width)
    points = block_middles(low, sides, inside.shape)
    flat = points.reshape(-1, points.shape[-1])
    moves = [
        _interpolation_at(low, sides, points_after(u, flat).reshape(points.shape), inside.shape)
        for u in range(len(admits))
    ]
    usual = _preferred_commands(inside, refused, moves)
    popular = serves.reshape(len(serves), -1).sum(axis=1)  # breaks ties: neighbours then agree
    ranked = misses * (popular.max() + 1) - popular.reshape(-1, *[1] * strict.ndim)
    entries = np.where((must + misses).any(axis=0), ranked.argmin(axis=0), usual)
    return LawTable(
        tuple(low), sides, _filled_entries(entries, inside | (must + misses).any(axis=0))
    )


def command_combinations(problem: Problem) -> list[tuple[float, ...]]:
    """Every combination of the controls' finite sets; the last control changes fastest."""
    return list(product(*problem.commands))


def _preferred_commands(inside: Bools, refused: Bools, moves: Sequence[Read]) -> Ints:
    """For each block the command that leads soonest to where an adversary needs longest for harm.

    Value iteration on the middles finds it, with multilinear interpolation; it proves nothing.
    """
    start = np.where(inside, NEVER, 0.0)
    margin = _iterate_until_still(
        start, lambda f: np.where(inside, 1.0 + np.min([m(f) for m in moves], axis=0), 0.0)
    )
    goal = inside & (margin >= GOAL_SHARE * np.where(inside, margin, 0.0).max())

    def time_by_command(time: Floats) -> Floats:
        later = np.stack([np.minimum(1.0 + m(time), NEVER) for m in moves])
        return np.where(refused, NEVER, later)

    def improved_time(time: Floats) -> Floats:
        return np.where(goal, 0.0, np.where(inside, time_by_command(time).min(axis=0), NEVER))

    time = _iterate_until_still(np.where(goal, 0.0, NEVER), improved_time)
    gain = np.where(refused, -1.0, np.stack([m(margin) for m in moves]))
    best: Ints = np.where(goal, gain.argmax(axis=0), time_by_command(time).argmin(axis=0))
    return best


def _iterate_until_still(f: Floats, improve: Callable[[Floats], Floats]) -> Floats:
    for _ in range(SWEEPS_MAX):
        following = improve(f)
        moved = np.abs(following - f).max()
        f = following
        if moved < 1e-2:
            break
    return f


def _interpolation_at(
    low: Sequence[float], width: Sequence[float], points: Floats, shape: tuple[int, ...]
) -> Read:
    """A function that interpolates values between the blocks' middles, constant beyond them."""
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


def _cells_within(cells: Bools, radius: int) -> Bools:
    """The cells within `radius` of a set, counted along axes and diagonals."""
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


def votes_by_block(votes: Bools, stride: int) -> Ints:
    """The number of cells in each block that vote for each command, (m, *cells) to (m, *blocks)."""
    count: Ints = votes.astype(np.int64)
    for axis in range(1, votes.ndim):
        starts = np.arange(0, votes.shape[axis], stride)
        summed: Ints = np.add.reduceat(count, starts, axis=axis)
        count = summed
    return count


def _filled_entries(entries: Ints, known: Bools) -> Ints:
    """The entries with each unknown entry copied from a known neighbour, layer by layer."""
    result: Ints = entries.copy()
    left = ~known
    while left.any() and not left.all():
        for axis in range(entries.ndim):
            for step in (1, -1):
                source = np.roll(result, step, axis=axis)
                source_known = ~np.roll(left, step, axis=axis)
                edge = [slice(None)] * entries.ndim
                edge[axis] = slice(0, 1) if step == 1 else slice(-1, None)
                source_known[tuple(edge)] = False
                take = left & source_known
                result[take] = source[take]
                left &= ~take
    return result


UNITS = (("s", 10**9), ("ms", 10**6), ("us", 10**3), ("ns", 1))
HEADER = "Found by `soter verify --synthesize`."


@dataclass(frozen=True)
class SynthesizedSource:
    """A program with its safe controller: the text of the module's file and the table's bytes."""

    node: str
    text: str
    data_name: str
    data: bytes

    def save(self, path: Path) -> tuple[Path, Path]:
        """Writes the program to `path` and the table beside it, or raises `OSError`."""
        beside = path_without_links(path.parent, self.data_name)
        path.write_text(self.text, encoding="utf-8")
        beside.write_bytes(self.data)
        return path, beside


def program_with_law(problem: Problem, table: LawTable) -> SynthesizedSource:
    """The program in which the module's SC is a node that reads this table."""
    symbol = problem.module.symbol
    assert symbol.sc_span is not None
    source = symbol.sc_span.source
    node = unused_name(f"{symbol.name.rpartition('.')[2]}SC", source.text)
    data_name = f"{node}.npy"
    text = "\n".join(_node_lines(problem, table, node, data_name)) + "\n\n"
    insertion = source.text.rfind("\n", 0, _start_of_module(symbol)) + 1
    program = (
        source.text[:insertion]
        + text
        + source.text[insertion : symbol.sc_span.start]
        + node
        + source.text[source.text.index(";", symbol.sc_span.start) :]
    )
    formatted = format_source(Source(source.name, program), Diagnostics())
    assert formatted is not None
    return SynthesizedSource(node, formatted, data_name, _law_as_npy(problem, table))


def _start_of_module(symbol: ModuleSymbol) -> int:
    """The offset of `rta Name`, or of the comment lines directly above it."""
    text = symbol.span.source.text
    at = text.rfind("\n", 0, symbol.span.start) + 1
    while at > 0:
        above = text.rfind("\n", 0, at - 1) + 1
        if not text[above:at].lstrip().startswith("//") or text[above:at].startswith("// ---"):
            break
        at = above
    return at


def _law_as_npy(problem: Problem, table: LawTable) -> bytes:
    """The bytes of a table for each control; entries are indices into its increasing commands.

    On a border between blocks an analysis joins the indices of each control. As commands increase
    with the indices, this adds only commands between the two.
    """
    sizes = [len(values) for values in problem.commands]
    parts = np.stack(np.unravel_index(table.entries, sizes)).astype(np.uint8)
    stream = io.BytesIO()
    np.save(stream, parts if len(sizes) > 1 else parts[0], allow_pickle=False)
    return stream.getvalue()


def _node_lines(problem: Problem, table: LawTable, node: str, data: str) -> Iterator[str]:
    reads = [_topic_and_path(problem, axis) for axis in range(table.entries.ndim)]
    topics = list(dict.fromkeys(topic for topic, _ in reads))
    symbol = problem.module.symbol
    controls = problem.quantities.controls
    size = " x ".join(str(n) for n in table.entries.shape)
    yield f"// {HEADER}"
    yield f"// {size} commands for {', '.join(f'{t}{p}' for t, p in reads)}."
    yield f"type {node}_Entry = int in [0, {max(map(len, problem.commands)) - 1}];"
    element = f"{node}_Entry"
    for k, n in reversed(list(enumerate(table.entries.shape))):
        yield f"type {node}_Axis{k} = {element}[{n}];"
        element = f"{node}_Axis{k}"
    if len(controls) > 1:
        yield f"type {node}_Tables = {element}[{len(controls)}];"
        element = f"{node}_Tables"
    yield f'const {node}_TABLE: {element} = data "{data}";'
    for leaf, values in zip(controls, problem.commands, strict=True):
        name = _constant_name(node, leaf.owner, leaf.path, problem)
        shown = ", ".join(_float_text(v) for v in values)
        yield f"const {name}: float[{len(values)}] = [{shown}];"
    yield f"fun {node}_block(value: float, low: float, width: float, count: int): int {{"
    yield "  let place = (clamp(value, low, low + width * float(count)) - low) / width;"
    yield "  return max(0, min(int(floor(place)), count - 1));"
    yield "}"
    yield f"node {node} period {_duration_text(problem.times.delta_sc)} {{"
    yield f"  subscribes {', '.join(topics)};"
    published = [_local_name(t, symbol) for t in symbol.sc.publishes]
    yield f"  publishes {', '.join(published)};"
    yield "  step {"
    for k, (topic, path) in enumerate(reads):
        low, width = _float_text(table.low[k]), _float_text(table.width[k])
        count = table.entries.shape[k]
        yield f"    let i{k} = {node}_block({topic}{path}, {low}, {width}, {count});"
    index = "".join(f"[i{k}]" for k in range(len(reads)))
    for j in range(len(controls)):
        of_control = f"[{j}]" if len(controls) > 1 else ""
        yield f"    let u{j} = {node}_TABLE{of_control}{index};"
    scope = problem.system.components[problem.module.sc].scope.topics
    for t in symbol.sc.publishes:
        value = _value_text(t.type, node, scope[t], (), problem)
        yield f"    publish {_local_name(t, symbol)} = {value};"
    yield "  }"
    yield "}"


def _topic_and_path(problem: Problem, axis: int) -> tuple[str, str]:
    """The topic and the path of an axis's state, as the file of the module names them."""
    state = problem.groups[0].axes[axis].state
    topic, leaf = problem.topic_leaf_of_state[state]
    state_topic = problem.system.topics[topic]
    path, _ = list(leaves(state_topic.type))[leaf]
    return _local_name(state_topic.symbol, problem.module.symbol), _path_text(path)


def _path_text(path: Sequence[str]) -> str:
    return "".join(p if p.startswith("[") else f".{p}" for p in path)


def _value_text(t: Type, node: str, topic: int, path: tuple[str, ...], problem: Problem) -> str:
    """The text of the value to publish; each leaf is a constant, indexed by the table's entry."""
    if isinstance(t, RecordType):
        parts = [f"{n}: {_value_text(f, node, topic, (*path, n), problem)}" for n, f in t.fields]
        return "{ " + ", ".join(parts) + " }"
    if isinstance(t, ArrayType):
        each = [
            _value_text(t.element, node, topic, (*path, f"[{i}]"), problem) for i in range(t.size)
        ]
        return "[" + ", ".join(each) + "]"
    assert isinstance(t, FloatType)
    owners = [(leaf.owner, leaf.path) for leaf in problem.quantities.controls]
    return f"{_constant_name(node, topic, path, problem)}[u{owners.index((topic, path))}]"


def _constant_name(node: str, topic: int, path: Sequence[str], problem: Problem) -> str:
    name = problem.system.topics[topic].symbol.name.rpartition(".")[2]
    parts = [name, *(p.strip("[]") for p in path)]
    return f"{node}_{'_'.join(parts).upper()}"


def _local_name(topic: TopicSymbol, module: ModuleSymbol) -> str:
    """The name of a topic in the file that declares the module."""
    home = module.name.rpartition(".")[0]
    if home and topic.name.startswith(home + "."):
        return topic.name[len(home) + 1 :]
    return topic.name


def _float_text(x: float) -> str:
    text = repr(float(x))
    return text if any(c in text for c in ".en") else text + ".0"


def _duration_text(ns: int) -> str:
    unit, size = next((u, n) for u, n in UNITS if ns % n == 0)
    return f"{ns // size}{unit}"
