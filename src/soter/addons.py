"""The add-ons beside the core, and how the core finds them.

Purpose: the table of add-ons. The core imports no module of them (`.importlinter`): it imports one
by name when it is used (`load_module`), and works without them otherwise.
Non-goals: entry points, which a checkout without metadata does not have.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import Any

from soter.diagnostics.diagnostic import Diagnostic, SoterError


@dataclass(frozen=True)
class AddOn:
    """An add-on: its packages and modules (`parts`), and the other add-ons that these import."""

    parts: tuple[str, ...]
    needs: tuple[str, ...] = ()


ADD_ONS = {
    "robots": AddOn(
        (
            "soter.mapping",
            "soter.monitor",
            "soter.remote",
            "soter.api.identifying",
            "soter.api.monitoring",
            "soter.cli.identify",
            "soter.cli.monitor",
            "soter.cli.terminal.log_judgement",
            "soter.targets.bridge_base",
            "soter.targets.message_conversion",
            "soter.targets.ros_packages",
            "soter.targets.ros_sources",
            "soter.targets.dds_package",
            "soter.targets.mavlink_package",
        )
    ),
    "learn": AddOn(("soter.gym", "soter.policy", "soter.cli.policy"), needs=("campaign",)),
    "campaign": AddOn(("soter.campaign", "soter.api.campaigning", "soter.cli.campaign")),
    "editor": AddOn(("soter.editor", "soter.playground", "soter.cli.lsp")),
    "assure": AddOn(
        (
            "soter.report.safety_case",
            "soter.report.safety_case_page",
            "soter.api.assurance",
            "soter.cli.assure",
        ),
        needs=("campaign",),
    ),
}


def add_on_of(module: str) -> str | None:
    """The add-on that a module belongs to; None for the core."""
    return next(
        (n for n, a in ADD_ONS.items() if any(f"{module}.".startswith(f"{p}.") for p in a.parts)),
        None,
    )


def load_module(module: str) -> Any:  # noqa: ANN401 - the caller knows its names
    """Imports a module of the core or of an add-on; raises D007 if the add-on is missing."""
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        missing = add_on_of(error.name or "")
        if missing is None:
            raise
        message = f"`{module}` is part of the add-on `{missing}`, which is not installed"
        raise SoterError((Diagnostic("D007", message),)) from error
