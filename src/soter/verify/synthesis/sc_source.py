"""A found safe controller as Soter source: a node and its table.

Purpose: from a `LawTable` to the text of a node, and the program with that node in the place of
`sc synthesized period d;`.
Non-goals: finding the table (`synthesize.py`), judging it (`verify.py`).
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from soter.diagnostics.diagnostic import Diagnostics
from soter.diagnostics.source import Source
from soter.language.model.types import ArrayType, FloatType, RecordType, leaves
from soter.language.syntax.printer import format_source
from soter.report.atomic_write import own_place

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from soter.language.model.typed import ModuleSymbol, TopicSymbol
    from soter.language.model.types import Type
    from soter.verify.problem.problem import Problem
    from soter.verify.synthesis.synthesize import LawTable

UNITS = (("s", 10**9), ("ms", 10**6), ("us", 10**3), ("ns", 1))
HEADER = "Found by `soter verify --synthesize`."


@dataclass(frozen=True)
class SynthesizedSource:
    """A program with its safe controller: the text of the module's file, and the table."""

    node: str
    text: str
    data_name: str
    data: bytes

    def save(self, path: Path) -> tuple[Path, Path]:
        """Write the program to `path` and the table beside it; OSError."""
        beside = own_place(path.parent, self.data_name)
        path.write_text(self.text, encoding="utf-8")
        beside.write_bytes(self.data)
        return path, beside


def written(problem: Problem, table: LawTable) -> SynthesizedSource:
    """The program in which the module's SC is a node that reads this table."""
    symbol = problem.module.symbol
    assert symbol.sc_span is not None
    source = symbol.sc_span.source
    node = free_name(f"{symbol.name.rpartition('.')[2]}SC", source.text)
    data_name = f"{node}.npy"
    text = "\n".join(_node(problem, table, node, data_name)) + "\n\n"
    at = source.text.rfind("\n", 0, _beginning(symbol)) + 1
    program = (
        source.text[:at]
        + text
        + source.text[at : symbol.sc_span.start]
        + node
        + source.text[source.text.index(";", symbol.sc_span.start) :]
    )
    formatted = format_source(Source(source.name, program), Diagnostics())
    assert formatted is not None
    return SynthesizedSource(node, formatted, data_name, _data(problem, table))


def free_name(name: str, text: str) -> str:
    """`name`, with underscores until the text does not have it."""
    while name in text:
        name += "_"
    return name


def _beginning(symbol: ModuleSymbol) -> int:
    """Where `rta Name` begins, or the comment lines right above it."""
    text = symbol.span.source.text
    at = text.rfind("\n", 0, symbol.span.start) + 1
    while at > 0:
        above = text.rfind("\n", 0, at - 1) + 1
        if not text[above:at].lstrip().startswith("//") or text[above:at].startswith("// ---"):
            break
        at = above
    return at


def _data(problem: Problem, table: LawTable) -> bytes:
    """One table for each control, of indices into its own commands, which increase.

    On a border between blocks an analysis joins indices: every control by itself, and nothing
    between two commands that is not between their values.
    """
    sizes = [len(values) for values in problem.commands]
    parts = np.stack(np.unravel_index(table.entries, sizes)).astype(np.uint8)
    stream = io.BytesIO()
    np.save(stream, parts if len(sizes) > 1 else parts[0], allow_pickle=False)
    return stream.getvalue()


# ---------------------------------------------------------------- the node


def _node(problem: Problem, table: LawTable, node: str, data: str) -> Iterator[str]:
    reads = [_read(problem, axis) for axis in range(table.entries.ndim)]
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
        name = _constant(node, leaf.owner, leaf.path, problem)
        shown = ", ".join(_float(v) for v in values)
        yield f"const {name}: float[{len(values)}] = [{shown}];"
    yield f"fun {node}_block(value: float, low: float, width: float, count: int): int {{"
    yield "  let place = (clamp(value, low, low + width * float(count)) - low) / width;"
    yield "  return max(0, min(int(floor(place)), count - 1));"
    yield "}"
    yield f"node {node} period {_duration(problem.times.delta_sc)} {{"
    yield f"  subscribes {', '.join(topics)};"
    published = [_local(t, symbol) for t in symbol.sc.publishes]
    yield f"  publishes {', '.join(published)};"
    yield "  step {"
    for k, (topic, path) in enumerate(reads):
        low, width = _float(table.low[k]), _float(table.width[k])
        count = table.entries.shape[k]
        yield f"    let i{k} = {node}_block({topic}{path}, {low}, {width}, {count});"
    index = "".join(f"[i{k}]" for k in range(len(reads)))
    for j in range(len(controls)):
        of_control = f"[{j}]" if len(controls) > 1 else ""
        yield f"    let u{j} = {node}_TABLE{of_control}{index};"
    scope = problem.system.components[problem.module.sc].scope.topics
    for t in symbol.sc.publishes:
        value = _value(t.type, node, scope[t], (), problem)
        yield f"    publish {_local(t, symbol)} = {value};"
    yield "  }"
    yield "}"


def _read(problem: Problem, axis: int) -> tuple[str, str]:
    """Topic and path of the state of an axis, as the module's file names them."""
    state = problem.groups[0].axes[axis].state
    topic, leaf = problem.topic_leaf_of_state[state]
    state_topic = problem.system.topics[topic]
    path = list(_paths(state_topic.type))[leaf]
    return _local(state_topic.symbol, problem.module.symbol), _joined(path)


def _paths(t: Type, path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    for p, _ in leaves(t, path):
        yield p


def _joined(path: Sequence[str]) -> str:
    return "".join(p if p.startswith("[") else f".{p}" for p in path)


def _value(t: Type, node: str, topic: int, path: tuple[str, ...], problem: Problem) -> str:
    """What is published: the constant of every leaf, at the table's entry."""
    if isinstance(t, RecordType):
        parts = [f"{n}: {_value(f, node, topic, (*path, n), problem)}" for n, f in t.fields]
        return "{ " + ", ".join(parts) + " }"
    if isinstance(t, ArrayType):
        each = [_value(t.element, node, topic, (*path, f"[{i}]"), problem) for i in range(t.size)]
        return "[" + ", ".join(each) + "]"
    assert isinstance(t, FloatType)
    owners = [(leaf.owner, leaf.path) for leaf in problem.quantities.controls]
    return f"{_constant(node, topic, path, problem)}[u{owners.index((topic, path))}]"


def _constant(node: str, topic: int, path: Sequence[str], problem: Problem) -> str:
    name = problem.system.topics[topic].symbol.name.rpartition(".")[2]
    parts = [name, *(p.strip("[]") for p in path)]
    return f"{node}_{'_'.join(parts).upper()}"


def _local(topic: TopicSymbol, module: ModuleSymbol) -> str:
    """A topic's name in the file that declares the module."""
    home = module.name.rpartition(".")[0]
    if home and topic.name.startswith(home + "."):
        return topic.name[len(home) + 1 :]
    return topic.name


def _float(x: float) -> str:
    text = repr(float(x))
    return text if any(c in text for c in ".en") else text + ".0"


def _duration(ns: int) -> str:
    unit, size = next((u, n) for u, n in UNITS if ns % n == 0)
    return f"{ns // size}{unit}"
