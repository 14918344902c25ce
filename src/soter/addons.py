"""The add-ons beside the core, and how the core finds them.

Purpose: the table of add-ons. The core imports no module of them (`.importlinter`): it imports one
by name when somebody uses it (`by_name`), and works without them otherwise.
Non-goals: entry points, which a checkout without metadata has not.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import Any

from soter.diagnostics.diagnostic import Diagnostic, SoterError


@dataclass(frozen=True)
class AddOn:
    """Packages and modules of one add-on; `needs`: other add-ons that they import."""

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


def by_name(module: str) -> Any:  # noqa: ANN401 - whoever asks says what it has
    """A module, of an add-on perhaps; SoterError D007 where that add-on is not installed."""
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        missing = add_on_of(error.name or "")
        if missing is None:
            raise
        what = f"`{module}` is part of the add-on `{missing}`, which is not installed"
        raise SoterError((Diagnostic("D007", what),)) from error
