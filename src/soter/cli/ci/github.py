"""Workflow commands of GitHub Actions: annotations beside the lines of a change.

Purpose: a line `::error file=...,line=...::message` for everything that is wrong or open.
Non-goals: other commands; what is fine.
Source: GitHub's documentation, "Workflow commands for GitHub Actions".
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.cli.ci.findings import place

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.cli.ci.findings import CiFinding

WORDS = {"fail": "error", "open": "error", "warning": "warning"}


def github(findings: Sequence[CiFinding]) -> str:
    """The commands, a line each; nothing where all is well."""
    return "\n".join(_command(f) for f in findings if f.kind != "pass")


def _command(finding: CiFinding) -> str:
    properties = {"title": f"soter: {finding.rule}"}
    at = place(finding.span)
    if at is not None:
        name, line, column, end_line, end_column = at
        properties |= {"file": name, "line": str(line), "endLine": str(end_line)}
        if line == end_line:  # else GitHub refuses columns
            properties |= {"col": str(column), "endColumn": str(end_column)}
    told = ",".join(f"{key}={_property(value)}" for key, value in properties.items())
    text = "\n".join((finding.text, *finding.details))
    return f"::{WORDS[finding.kind]} {told}::{_data(text)}"


def _data(text: str) -> str:
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _property(text: str) -> str:
    return _data(text).replace(":", "%3A").replace(",", "%2C")
