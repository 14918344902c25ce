"""What a log holds of what a mapping asks for, whatever file it is.

Purpose: the one way from a path, or several CSVs that are one log, to columns.
Non-goals: the kinds of files (`csv_log.py`, `message_log.py`).
"""

from __future__ import annotations

from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING

from soter.mapping.topic_mapping import NearestSource
from soter.monitor.logs.files.csv_log import is_table, read_csv
from soter.monitor.logs.files.log_columns import seconds_text, unusable, wanted_columns
from soter.monitor.logs.files.message_log import read_messages

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.mapping.topic_mapping import LogMap
    from soter.monitor.logs.files.log_columns import Columns, Wanted

CLOCKS = "several CSVs are one log where their times are of one clock: `[time]` of the mapping"


def read_columns(
    log: Path | Sequence[Path], mapping: LogMap, *, partial: bool = False
) -> dict[str | None, Columns]:
    """What each channel of a mapping holds; a CSV is the channel None. SoterError D016, D007.

    Of several CSVs a channel is the name of one, as the mapping writes it. `partial`: of a damaged
    file what stands before the damage.
    """
    paths = [log] if isinstance(log, Path) else [*log]
    path = paths[0]
    for t in mapping.topics:
        for leaf_path, leaf in t.leaves.items():
            if isinstance(leaf, NearestSource):
                what = "is what is nearest in a scan, which a robot can take and a log cannot give"
                raise unusable(path, f"`{t.name_of(leaf_path)}` {what}")
    table = len(paths) == 1 and is_table(path)
    wanted = wanted_columns(path, mapping, table=table)
    if table:
        columns: dict[str | None, Columns] = {
            None: read_csv(path, mapping, wanted[None], partial=partial)
        }
    elif len(paths) > 1:
        columns = _of_several(paths, mapping, wanted, partial=partial)
    else:
        columns = read_messages(path, mapping, wanted, partial=partial)
    times = [t for c in columns.values() for t in (c.times_ns[0], c.times_ns[-1])]
    if min(times) == max(times) and any(c.equal for c in columns.values()):
        said = f"time stands still: all that counts is of {seconds_text(times[0])} s"
        raise unusable(path, said, "`[time] from` names another time: docs/mapping.md, Logs")
    return columns


def _of_several(
    paths: Sequence[Path],
    mapping: LogMap,
    wanted: dict[str | None, Wanted],
    *,
    partial: bool,
) -> dict[str | None, Columns]:
    """What each of several CSVs holds, by the name under which the mapping knows it."""
    other = next((p for p in paths if not is_table(p)), None)
    if other is not None:
        raise unusable(other, "of several files that are one log each is a CSV, and this is none")
    columns: dict[str | None, Columns] = {}
    for channel, asked in wanted.items():
        meant = [p for p in paths if fnmatchcase(p.name, channel or "")]
        if len(meant) != 1:
            names = ", ".join(f"`{p.name}`" for p in paths)
            told = f"a topic has the `channel` {channel}" if channel else "a topic has no `channel`"
            help_ = "the `channel` of a topic is the name of one of them; `*` stands for any text"
            raise unusable(paths[0], f"{told}, and {len(meant)} of {names} are called so", help_)
        columns[channel] = read_csv(meant[0], mapping, asked, partial=partial)
    begins, ends = zip(*(c.log_ns for c in columns.values()), strict=True)
    if max(begins) > min(ends):
        late = max(columns, key=lambda k: columns[k].log_ns[0])
        told = f"`{late}` begins at {seconds_text(max(begins))} s, when another one has ended"
        raise unusable(paths[0], f"{told}, at {seconds_text(min(ends))} s", CLOCKS)
    return columns
