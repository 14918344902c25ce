"""What a log holds of what a mapping asks for, whatever file it is.

Purpose: the one way from a path to columns.
Non-goals: the kinds of files (`csv_log.py`, `message_log.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.monitor.logs.files.csv_log import is_table, read_csv
from soter.monitor.logs.files.log_columns import wanted_columns
from soter.monitor.logs.files.message_log import read_messages

if TYPE_CHECKING:
    from pathlib import Path

    from soter.mapping.topic_mapping import LogMap
    from soter.monitor.logs.files.log_columns import Columns


def read_columns(path: Path, mapping: LogMap) -> dict[str | None, Columns]:
    """What each channel of a mapping holds; a CSV is the channel None. SoterError D016, D007."""
    table = is_table(path)
    wanted = wanted_columns(path, mapping, table=table)
    if table:
        return {None: read_csv(path, mapping, wanted[None])}
    return read_messages(path, mapping, wanted)
