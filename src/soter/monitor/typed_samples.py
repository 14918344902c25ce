"""Makes typed values of topics, with their times, from the columns of a log.

Purpose: `read_samples` makes values of the program's types from columns and a mapping; it counts
what it leaves out, and names what it derives, with its error.
Non-goals: whether a value lies in its topic's set: the gate decides.
"""

from __future__ import annotations

import math
import re
from bisect import bisect_right
from dataclasses import dataclass, field, replace
from itertools import groupby, pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.language.evaluate.arithmetic import StepFault
from soter.language.model.types import (
    ArrayType,
    BoolType,
    DurationType,
    EnumType,
    FloatType,
    IntType,
    RecordType,
    leaves,
    show_ns,
)
from soter.mapping.message_types import HEADER_FRAME
from soter.mapping.topic_mapping import ConstantSource, SignalSource, SlopeSource, SourceTurns
from soter.monitor import derived_signals as derived
from soter.monitor.derived_signals import error_quantiles
from soter.monitor.log_files.log_columns import (
    TRUTHS,
    Columns,
    FarStamps,
    RowChoice,
    is_plain_number,
    unusable_log_error,
    whole_number,
)
from soter.semantics.draws import value_of_leaves
from soter.semantics.publication_gate import check_of_topic, clip_to_set

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from soter.language.model.system import Topic
    from soter.language.model.types import Type, Value
    from soter.mapping.topic_mapping import LeafPath, LogMap, TopicMap
    from soter.semantics.publication_gate import Check


UNSTAMPED = 'where no stamp can be used: stamp = "arrival" counts from when messages came'
REASONS_MAX = 8
"""So many reasons for leaving out samples of a topic are counted apart, the others as one."""


@dataclass(frozen=True)
class DerivedValue:
    """A derived leaf or topic: how it was made, and 50, 95 and 100 % quantiles of its error."""

    name: str
    how: str
    error: tuple[float, float, float] | None


@dataclass
class TopicSamples:
    """The samples of one topic: `values[i]` came at `times_ns[i]`; without times, a constant.

    `stamps_ns[i]`: when it was measured, by the field `stamp`, or the declared delay before it
    came. `log_ns`: when the whole log begins and ends. `reasons`: why rows gave no sample, with the
    number of rows and the first; reasons are one if they differ only after a number. `sources`: how
    many samples each of several sources gave. `assumed_units`: as in `TopicMap`. `turns`: the turn
    of each leaf, infinite if it is no angle; `begins`: the least angle of each, for lines.
    `clipped`: how many samples were clipped, in words.
    """

    topic: Topic
    times_ns: list[int]
    values: list[Value]
    linear: bool = False
    gap_ns: int = 0
    log_ns: tuple[int, int] = (0, 0)
    reasons: dict[str, tuple[int, str]] = field(default_factory=dict)
    far_stamps: FarStamps | None = None
    stamps_ns: list[int] = field(default_factory=list)
    stamp: str = ""
    derived: list[DerivedValue] = field(default_factory=list)
    constants: list[str] = field(default_factory=list)
    assumed_units: list[str] = field(default_factory=list)
    sources: str = ""
    turns: list[float] = field(default_factory=list)
    begins: list[float] = field(default_factory=list)
    clipped: str = ""

    @property
    def is_constant(self) -> bool:
        """Whether the topic has one value at all times."""
        return not self.times_ns

    def count_far_stamp(self, stamp_ns: int | None, now_ns: int) -> None:
        """Counts a stamp that is further from its arrival than the log is long."""
        if stamp_ns is None or stamp_ns <= 0:
            return
        offset_ns, length_ns = stamp_ns - now_ns, self.log_ns[1] - self.log_ns[0]
        if abs(offset_ns) > length_ns:
            before = self.far_stamps or FarStamps(0, 0.0, length_ns / 1e9)
            furthest = max(before.offset_s, offset_ns / 1e9, key=abs)
            self.far_stamps = replace(before, samples=before.samples + 1, offset_s=furthest)

    def why_no_later_stamp(self, stamp_ns: int) -> str:
        """The reason, in words, why a stamp is not later than the last; "" if it is later."""
        if self.stamps_ns and stamp_ns <= self.stamps_ns[-1]:
            return "its stamp is older than the one before it, or the same"
        return ""

    def count_left_out(self, where: str, why: str) -> None:
        """Counts a row that gives no sample."""
        reason = re.split(r"\d", why, maxsplit=1)[0]
        if reason not in self.reasons and len(self.reasons) >= REASONS_MAX:
            reason = ""
        count, first = self.reasons.get(reason, (0, f"{where}: {why}"))
        self.reasons[reason] = count + 1, first

    @property
    def left_out(self) -> int:
        """The number of rows that gave no sample."""
        return sum(count for count, _ in self.reasons.values())

    @property
    def first_left_out(self) -> str:
        """The first row without a sample, and why it has none; "" if each row has a sample."""
        return next((first for _, first in self.reasons.values()), "")

    @property
    def lost(self) -> list[str]:
        """Notes for people on samples that were not used, and on stamps of another clock."""
        name = self.topic.name
        texts = [
            f"left out: {count:,} samples of {name}; the first: {first}"
            for count, first in self.reasons.values()
        ]
        texts += [self.clipped] * bool(self.clipped)
        if self.far_stamps is not None:
            texts.append(
                f"{self.far_stamps.samples:,} stamps of {name} (`{self.stamp}`) {self.far_stamps}"
            )
        return texts

    @property
    def from_ns(self) -> int:
        """The time of the first value; of values along lines, the begin of the first line."""
        return self.times_ns[1 if self.linear and len(self.times_ns) > 1 else 0]

    def value_at(self, time_ns: int) -> Value | None:
        """The value at a time, from samples up to this time; None if they do not determine it.

        At the stamp of a sample, it is this sample. For at most `gap_ns` after it, the value lies
        on the line through the last two samples, if they are no further apart than `gap_ns`.
        """
        i = bisect_right(self.times_ns, time_ns) - 1
        if time_ns < self.from_ns:
            return None
        since = time_ns - self.stamps_ns[i]
        if since == 0:
            return self.values[i]
        apart = self.stamps_ns[i] - self.stamps_ns[i - 1]
        if i == 0 or since > self.gap_ns or apart > self.gap_ns:
            return None
        before, last = (_leaf_values(self.topic.type, v) for v in self.values[i - 1 : i + 1])
        leaf_values = zip(before, last, self.turns, self.begins, strict=True)
        ahead = (
            derived.value_on_line(a, b, since / apart, turn, begin) if isinstance(b, float) else b
            for a, b, turn, begin in leaf_values
        )
        return value_of_leaves(self.topic.type, ahead)

    def unwrapped_value(self, before: Value, value: Value) -> Value:
        """The value with whole turns added to its angles, so that they lie nearest to `before`."""
        near, far = (_leaf_values(self.topic.type, v) for v in (before, value))
        both = zip(near, far, self.turns, strict=True)
        going = (b if math.isinf(turn) else a + math.remainder(b - a, turn) for a, b, turn in both)
        return value_of_leaves(self.topic.type, going)


def _leaf_values(t: Type, value: Value) -> list[Value]:
    """The leaves of a value, in the order of `leaves(t)`."""
    if isinstance(t, (RecordType, ArrayType)):
        parts = [f for _, f in t.fields] if isinstance(t, RecordType) else [t.element] * t.size
        return [x for part, v in zip(parts, value, strict=True) for x in _leaf_values(part, v)]
    return [value]


def read_samples(
    path: Path, mapping: LogMap, columns: dict[str | None, Columns]
) -> list[TopicSamples]:
    """The samples of all mapped topics, with times from the log's first row; raises D016."""
    first = min(c.times_ns[0] for c in columns.values())
    begins, ends = zip(*(c.log_ns for c in columns.values()), strict=True)
    log_ns = min(begins) - first, max(ends) - first
    samples = []
    for _, maps in groupby(mapping.topics, key=lambda t: t.topic.index):
        sources = [(t, columns.get(t.channel, columns.get(None, Columns()))) for t in maps]
        t, rows = sources[0]
        made = TopicSamples(t.topic, [], [], t.linear, t.gap_ns, log_ns)
        made.turns = [getattr(t.leaves[p], "turn", math.inf) for p, _ in leaves(t.topic.type)]
        made.assumed_units = list(dict.fromkeys(x for one, _ in sources for x in one.assumed_units))
        if t.promise is not None:
            _take_samples_of_sources(path, sources, made, first)
        elif t.names:
            _add_rows(path, t, rows, made, first)
        else:
            _add_constants(t, made)
        if t.clip:
            inside = [clip_to_set(t.topic.type, t.topic.bounds, value) for value in made.values]
            moved = sum(a != b for a, b in zip(inside, made.values, strict=True))
            made.clipped = f"clipped to its set: {moved:,} samples of {t.topic.name}" * bool(moved)
            made.values = inside
        if t.linear:
            by_leaf = zip(*(_leaf_values(t.topic.type, v) for v in made.values), strict=True)
            made.begins = [*map(derived.begin_of_turn, by_leaf, made.turns)]
        samples.append(made)
    return samples


def _add_constants(t: TopicMap, made: TopicSamples) -> None:
    made.values.append(_value_of_leaves(t.topic.type, _constant_leaves(t)))
    made.constants = [t.leaf_name(p) for p in t.leaves]


def _add_rows(path: Path, t: TopicMap, columns: Columns, made: TopicSamples, first_ns: int) -> None:
    read: dict[LeafPath, list[Any]] = {
        p: [] for p, x in t.leaves.items() if isinstance(x, SignalSource)
    }
    stamps: Sequence[int | None] = [now - t.delay_ns for now in columns.times_ns]
    if t.stamp is not None:
        stamps, made.stamp = columns.stamps_ns[t.stamp], t.stamp.path
    elif t.delay_ns > 0:
        made.stamp = f"arrival less {show_ns(t.delay_ns)}"
    choice = RowChoice(t.where)
    follows_lines = t.linear or any(isinstance(x, SlopeSource) for x in t.leaves.values())
    for i, now in enumerate(columns.times_ns):
        if not choice.chooses(lambda name: columns.cells[name][i]):  # noqa: B023 - called at once
            continue
        why = _why_other_frame(t, columns, i)
        stamp_ns = (stamps[i] or 0) - first_ns
        if t.stamp is not None and not why:
            made.count_far_stamp(stamps[i], now)
            why = _why_ill_stamped(stamps[i], now) or made.why_no_later_stamp(stamp_ns)
        row, why = ({}, why) if why else _row_values(path, t, columns, i)
        if why:
            made.count_left_out(columns.where[i], why)
            continue
        if follows_lines and made.times_ns and made.stamps_ns[-1] == stamp_ns:
            for column in (made.times_ns, made.stamps_ns, *read.values()):
                column.pop()  # no line goes through two values at one time: the later one counts
        made.times_ns.append(now - first_ns)
        made.stamps_ns.append(stamp_ns)
        for p, value in row.items():
            read[p].append(value)
    if not made.times_ns:
        required = f"all of `{t.topic.name}`" + (f" and {choice}" if t.where else "")
        arrival = UNSTAMPED if "its stamp" in made.first_left_out else ""
        helps = (made.first_left_out, arrival, *choice.seen_values)
        raise unusable_log_error(path, f"no row of it has {required}", *helps)
    _build_values(path, t, made, read)


def _take_samples_of_sources(
    path: Path, sources: list[tuple[TopicMap, Columns]], made: TopicSamples, first_ns: int
) -> None:
    """Takes samples of several sources in the order of arrival, as a bridge does."""
    topic = made.topic
    made.stamp = ", ".join(dict.fromkeys(t.stamp.path for t, _ in sources if t.stamp is not None))
    made.constants = [n for t, _ in sources for n in map(t.leaf_name, _constant_leaves(t))]
    turns = SourceTurns([t.promise.after_ns for t, _ in sources if t.promise is not None])
    taken = []
    check = check_of_topic(topic)
    choices = [RowChoice(t.where) for t, _ in sources]
    arrivals = [(now, k, i) for k, (_, c) in enumerate(sources) for i, now in enumerate(c.times_ns)]
    for now, rank, i in sorted(arrivals):
        t, columns = sources[rank]
        if not choices[rank].chooses(lambda name: columns.cells[name][i]):  # noqa: B023 - the same
            continue
        if t.stamp is not None:
            made.count_far_stamp(columns.stamps_ns[t.stamp][i], now)
        value, stamp, why = _source_row(path, t, columns, i, check)
        if why:
            made.count_left_out(columns.where[i], why)
        elif turns.judge(rank, stamp) == "taken":
            made.times_ns.append(now - first_ns)
            made.stamps_ns.append(stamp - first_ns)
            made.values.append(value)
            taken.append(rank)
    if not made.times_ns:
        seen = [help_ for choice in choices for help_ in choice.seen_values]
        raise unusable_log_error(
            path, f"no row of it has all of `{topic.name}`", made.first_left_out, *seen
        )
    made.sources = _sources_text([t.channel for t, _ in sources], taken)


def _sources_text(channels: Sequence[str | None], taken: Sequence[int]) -> str:
    """How many samples each source gave, and how often the source changed, in words."""
    counts = [f"{channel or k + 1} ({taken.count(k):,})" for k, channel in enumerate(channels)]
    changes = sum(a != b for a, b in pairwise(taken))
    return f"{', '.join(counts)}, {changes:,} changes from one to the other"


def _constant_leaves(t: TopicMap) -> dict[LeafPath, Value]:
    return {p: x.value for p, x in t.leaves.items() if isinstance(x, ConstantSource)}


def _source_row(
    path: Path, t: TopicMap, columns: Columns, i: int, check: Check
) -> tuple[Value, int, str]:
    """The value and stamp of a source's row, and why it gives no sample, or ""."""
    assert t.stamp is not None
    stamp = columns.stamps_ns[t.stamp][i]
    why = _why_other_frame(t, columns, i) or _why_ill_stamped(stamp, columns.times_ns[i])
    if why:
        return None, 0, why
    row, why = _row_values(path, t, columns, i)
    if why:
        return None, 0, why
    value = _value_of_leaves(t.topic.type, {**row, **_constant_leaves(t)})
    try:
        check(value, t.topic.symbol.span)
    except StepFault as fault:
        return None, 0, fault.detail
    return value, stamp or 0, ""


def _row_values(
    path: Path, t: TopicMap, columns: Columns, i: int
) -> tuple[dict[LeafPath, Value | None], str]:
    """The values of leaves that a row's cells give, and why it gives no sample, or ""."""
    types = dict(leaves(t.topic.type))
    row = {
        p: _cell_value(path, types[p], leaf, columns.cells[leaf.name][i], columns.where[i])
        for p, leaf in t.leaves.items()
        if isinstance(leaf, SignalSource)
    }
    lost = next((p for p, value in row.items() if value is None), None)
    return row, "" if lost is None else f"no finite number for `{t.leaf_name(lost)}`"


def _why_other_frame(t: TopicMap, columns: Columns, i: int) -> str:
    """The reason, in words, why a row has another frame than the mapping takes; else ""."""
    if t.frame_id is None:
        return ""
    frame = columns.cells[HEADER_FRAME][i]
    shown = str(frame).strip()
    return "" if shown == t.frame_id else f"its frame is `{shown[:40]}`, not `{t.frame_id}`"


def _why_ill_stamped(stamp: int | None, now: int) -> str:
    """The reason why a stamp cannot be a time of measurement, in words; "" if it can."""
    if stamp is None:
        return "it has no stamp"
    if stamp <= 0:
        return "its stamp is 0" if stamp == 0 else "its stamp lies before 0"
    if stamp > now:
        return f"its stamp lies {show_ns(stamp - now)} after its arrival"
    return ""


def _build_values(
    path: Path, t: TopicMap, made: TopicSamples, read: dict[LeafPath, list[Any]]
) -> None:
    """Enters slopes and constants, and joins the leaves of each sample to a value."""
    n = len(made.times_ns)
    times_s = np.array(made.stamps_ns, dtype=np.float64) / 1e9
    table: dict[LeafPath, list[Any]] = dict(read)
    for p, leaf in t.leaves.items():
        if isinstance(leaf, ConstantSource):
            table[p] = [leaf.value] * n
            made.constants.append(t.leaf_name(p))
        elif isinstance(leaf, SlopeSource):
            if n < 2:
                raise unusable_log_error(path, f"one sample of `{t.topic.name}` has no slope")
            values, window = _unwrapped_column(t, leaf.of, read[leaf.of]), leaf.window_ns / 1e9
            derivatives = derived.window_slopes(times_s, values, window)
            error = error_quantiles(derived.slope_errors(times_s, values, window, derivatives))
            how = (
                f"slope over the last {show_ns(leaf.window_ns)}, from the second sample on; error: "
                "against the slope over half the window"
            )
            made.derived.append(DerivedValue(t.leaf_name(p), how, error))
            table[p] = derivatives.tolist()
    if any(isinstance(leaf, SlopeSource) for leaf in t.leaves.values()):
        del made.times_ns[0], made.stamps_ns[0]  # where there is no slope yet
        times_s, table, n = times_s[1:], {p: v[1:] for p, v in table.items()}, n - 1
    if t.linear:
        _note_errors_ahead(t, made, times_s, table)
    for i in range(n):
        made.values.append(_value_of_leaves(t.topic.type, {p: v[i] for p, v in table.items()}))


def _unwrapped_column(t: TopicMap, p: LeafPath, column: list[Any]) -> np.ndarray[Any, Any]:
    """The values of a leaf, (n,), with turns added so that none jumps more than half a turn."""
    turn = min(getattr(t.leaves[p], "turn", math.inf), 1e300)  # NumPy knows no infinite period
    return np.unwrap(np.array(column, dtype=np.float64), period=turn)


def _note_errors_ahead(
    t: TopicMap, made: TopicSamples, times_s: np.ndarray[Any, Any], table: dict[LeafPath, list[Any]]
) -> None:
    """Notes how far straight lines are from the samples; times_s (n,)."""
    for p, kind in leaves(t.topic.type):
        if isinstance(kind, FloatType) and not isinstance(t.leaves[p], ConstantSource):
            values = _unwrapped_column(t, p, table[p])
            error = error_quantiles(derived.line_errors(times_s, values, t.gap_ns / 1e9))
            how = (
                "on the line through the last two samples, for at most "
                f"{show_ns(t.gap_ns)}; error: how far the next sample is off it"
            )
            if error is None or error[-1] > 0.0:
                made.derived.append(DerivedValue(t.leaf_name(p), how, error))


def _value_of_leaves(t: Type, value_by_path: Mapping[LeafPath, Value]) -> Value:
    return value_of_leaves(t, (value_by_path[path] for path, _ in leaves(t)))


# ---------------------------------------------------------------- cells


def _cell_value(path: Path, t: Type, leaf: SignalSource, cell: object, where: str) -> Value | None:
    """A cell's value; None for an empty cell, NaN or infinity. Raises D016 for other texts."""
    if isinstance(cell, str):
        cell = cell.strip()
    if cell is None or cell == "":
        return None
    try:
        if isinstance(t, FloatType):
            return _float_value(leaf, cell)
        return _discrete_value(t, cell)
    except (ValueError, TypeError, OverflowError) as error:
        shown = str(cell)[:40]
        text = f"`{shown}` in {where}, `{leaf.name}`, is no `{t}`"
        raise unusable_log_error(path, text) from error


def _float_value(leaf: SignalSource, cell: Any) -> float | None:  # noqa: ANN401 - a text, or what JSON has
    if isinstance(cell, bool):
        raise TypeError
    if isinstance(cell, str) and not is_plain_number(cell):
        raise ValueError
    value = float(cell)
    if leaf.scale != 1.0:
        value = leaf.scale * value
    if leaf.offset != 0.0:
        value = value + leaf.offset
    return value if math.isfinite(value) else None


def _discrete_value(t: Type, cell: Any) -> Value:  # noqa: ANN401 - the same
    if isinstance(t, BoolType):
        if isinstance(cell, bool):
            return cell
        truth = TRUTHS.get(str(cell).lower())
        return (False, True)[_checked_between(0, whole_number(cell), 1)] if truth is None else truth
    if isinstance(t, EnumType):
        return t.members.index(str(cell))
    if isinstance(cell, bool) or not isinstance(t, (IntType, DurationType)):
        raise TypeError
    number = whole_number(cell)
    return _checked_between(t.low, number, t.high) if isinstance(t, IntType) else number


def _checked_between(low: int, value: int, high: int) -> int:
    if not low <= value <= high:
        raise ValueError
    return value
