"""What `soter run --log` wrote, message by message.

Purpose: `messages` and `metadata` of an MCAP log of Soter's own, each vouched for by the file;
what cannot be read is SoterError D006.
Non-goals: what messages mean; logs of somebody else (`monitor/logs/`).
"""

from __future__ import annotations

import json
from contextlib import contextmanager
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.diagnostics.os_error_text import reason
from soter.language.load.bounded_read import opened
from soter.report.mcap_log import ABNORMALLY, END_NAME, METADATA_NAME
from soter.report.mcap_records import CutMcapError, DamagedMcapError, McapRecords

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path


def require_log_package() -> None:
    """SoterError D007 where the package that writes logs is not installed."""
    if find_spec("mcap") is None:
        raise SoterError(
            (
                Diagnostic(
                    "D007",
                    "logs are written with the package `mcap`, which is not installed",
                    helps=("install it: pip install 'soter[log]'",),
                ),
            )
        )


@contextmanager
def _records(path: Path) -> Iterator[McapRecords]:
    """The records of a log; what cannot be opened or read, or is damaged, is SoterError D006."""
    try:
        with opened(path) as file:
            yield McapRecords(file)
    except OSError as error:
        raise unreadable(path, reason(error)) from error
    except SoterError:
        raise
    except DamagedMcapError as error:
        text = f"cannot read the log `{path}`: {error}"
        raise SoterError((Diagnostic("D006", text, helps=(error.remedy,)),)) from error
    except Exception as error:
        raise unreadable(path, damaged(error)) from error


def metadata(path: Path) -> dict[str, str]:
    """What a log says of its run, empty where it is none of `soter run`; SoterError D006.

    It stands at the beginning: the end of the file may be missing.
    """
    with _records(path) as records:
        for _ in _up_to_cut(records, lambda _: None):
            if METADATA_NAME in records.metadata:
                break
        return records.metadata.get(METADATA_NAME, {})


def messages(
    path: Path, cut: Callable[[str], None] | None = None
) -> Iterator[tuple[int, str, Any]]:
    """Time (ns), channel and message of all that is in a log, in order; SoterError D006.

    What its checksums and counts say is compared with what stands there. `cut`: told where the end
    of the file is missing, which is then read up to there, and where it says that the run has an
    end of which no log was written.
    """
    last_ns = 0
    with _records(path) as records:
        for channel, _, message in _up_to_cut(records, cut):
            if message.log_time < last_ns:
                told = (
                    f"time goes back from {last_ns / 1e9:.9g} s to {message.log_time / 1e9:.9g} s"
                )
                raise unreadable(path, f"{told} at a message of `{channel.topic}`")
            last_ns = message.log_time
            yield message.log_time, channel.topic, json.loads(message.data)
        ended = records.metadata.get(END_NAME, {}).get("ended", "")
        if cut is not None and ended.startswith(ABNORMALLY):
            cut(ended.removeprefix(ABNORMALLY))


def _up_to_cut(
    records: McapRecords, cut: Callable[[str], None] | None
) -> Iterator[tuple[Any, Any, Any]]:
    try:
        yield from records.messages()
    except CutMcapError as error:
        if cut is None:
            raise
        cut(str(error))


def damaged(error: Exception) -> str:
    """What is wrong with a log that the package `mcap` could not read, in words.

    It unpacks what stands there without a look at it: a damaged file makes it raise anything.
    """
    from mcap.exceptions import InvalidMagic, McapError  # noqa: PLC0415 - an extra

    told = isinstance(error, (McapError, ValueError)) and not isinstance(error, InvalidMagic)
    said = str(error)[:200] if told else ""
    return said or "it is no MCAP file, or damaged"


def unreadable(path: Path, why: str) -> SoterError:
    """Of a log that cannot be read as one of `soter run --log`."""
    helps = ("a log of somebody else, a CSV or a bag needs `--map FILE`: docs/real-logs.md",)
    return SoterError((Diagnostic("D006", f"cannot read the log `{path}`: {why}", helps=helps),))
