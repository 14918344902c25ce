"""What a log holds of what a mapping asks for, whatever file it is.

Purpose: the one way from a path to columns.
Non-goals: the kinds of files (`csv_log.py`, `message_log.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.mapping.topic_mapping import NearestSource
from soter.monitor.logs.files.csv_log import is_table, read_csv
from soter.monitor.logs.files.log_columns import seconds_text, unusable, wanted_columns
from soter.monitor.logs.files.message_log import read_messages

if TYPE_CHECKING:
    from pathlib import Path

    from soter.mapping.topic_mapping import LogMap
    from soter.monitor.logs.files.log_columns import Columns


def read_columns(path: Path, mapping: LogMap) -> dict[str | None, Columns]:
    """What each channel of a mapping holds; a CSV is the channel None. SoterError D016, D007."""
    for t in mapping.topics:
        for leaf_path, leaf in t.leaves.items():
            if isinstance(leaf, NearestSource):
                what = "is what is nearest in a scan, which a robot can take and a log cannot give"
                raise unusable(path, f"`{t.name_of(leaf_path)}` {what}")
    table = is_table(path)
    wanted = wanted_columns(path, mapping, table=table)
    if table:
        columns: dict[str | None, Columns] = {None: read_csv(path, mapping, wanted[None])}
    else:
        columns = read_messages(path, mapping, wanted)
    times = [t for c in columns.values() for t in (c.times_ns[0], c.times_ns[-1])]
    if min(times) == max(times) and any(c.equal for c in columns.values()):
        said = f"time stands still: all that counts is of {seconds_text(times[0])} s"
        raise unusable(path, said, "`[time] from` names another time: docs/mapping.md, Logs")
    return columns
