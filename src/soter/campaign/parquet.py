"""Flights as Parquet, for those who read tables elsewhere.

Purpose: `flights.parquet` beside `flights.csv`, with the same columns.
Non-goals: keeping flights (`store.py`).
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING

from soter.campaign.store import FLIGHTS
from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.diagnostics.os_error_text import reason

if TYPE_CHECKING:
    from pathlib import Path

NAME = "flights.parquet"


def require_parquet() -> None:
    """SoterError D007 where the package that writes Parquet is not installed."""
    if find_spec("pyarrow") is None:
        message = "Parquet is written with the package `pyarrow`, which is not installed"
        helps = ("install it: pip install 'soter[parquet]'; `flights.csv` says the same",)
        raise SoterError((Diagnostic("D007", message, helps=helps),))


def write_parquet(folder: Path) -> Path:
    """Write the flights of a campaign's folder as Parquet; SoterError D006, D007."""
    require_parquet()
    from pyarrow import csv, parquet  # noqa: PLC0415 - an extra

    target = folder / NAME
    beside = target.with_suffix(".part")
    try:
        parquet.write_table(csv.read_csv(folder / FLIGHTS), beside)
        beside.replace(target)
    except OSError as error:
        what = f"`{target}`: {reason(error)}"
        raise SoterError((Diagnostic("D006", what),)) from error
    return target
