"""SARIF 2.1.0: what code scanning shows beside the lines of a program.

Purpose: one run with a result for everything that is wrong or open, and a rule for every code with
its page of `soter explain`. What is proved or clean is no result: viewers show each as an alert.
Non-goals: other versions; fixes.
Source: OASIS Standard "Static Analysis Results Interchange Format (SARIF) Version 2.1.0".
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from soter.cli.ci.findings import place
from soter.diagnostics.explain import explain, title
from soter.version import VERSION

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.cli.ci.findings import CiFinding

SCHEMA = (
    "https://docs.oasis-open.org/sarif/sarif/v2.1.0/errata01/os/schemas/sarif-schema-2.1.0.json"
)
LEVELS = {"fail": "error", "open": "error", "warning": "warning"}


def sarif(command: str, findings: Sequence[CiFinding], exit_code: int) -> str:
    """The document, as text."""
    shown = [f for f in findings if f.kind != "pass"]
    rules = sorted({f.rule for f in shown})
    run = {
        "tool": {
            "driver": {"name": "soter", "version": VERSION, "rules": [_rule(r) for r in rules]}
        },
        "columnKind": "unicodeCodePoints",
        "automationDetails": {"id": f"soter/{command}/"},
        "invocations": [{"executionSuccessful": exit_code in (0, 1, 3, 4), "exitCode": exit_code}],
        "results": [_result(f, rules.index(f.rule)) for f in shown],
    }
    document = {"$schema": SCHEMA, "version": "2.1.0", "runs": [run]}
    return json.dumps(document, indent=2, allow_nan=False)


def _rule(code: str) -> dict[str, Any]:
    rule: dict[str, Any] = {"id": code}
    page = explain(code)
    if page is not None:
        rule["shortDescription"] = {"text": title(code) or code}
        rule["help"] = {"text": page, "markdown": page}
    return rule


def _result(finding: CiFinding, rule: int) -> dict[str, Any]:
    text = "\n".join((finding.text, *finding.details))
    result: dict[str, Any] = {
        "ruleId": finding.rule,
        "ruleIndex": rule,
        "level": LEVELS[finding.kind],
        "message": {"text": text},
    }
    at = place(finding.span)
    if at is not None:
        name, line, column, end_line, end_column = at
        region = {
            "startLine": line,
            "startColumn": column,
            "endLine": end_line,
            "endColumn": end_column,
        }
        physical = {"artifactLocation": {"uri": _uri(name)}, "region": region}
        result["locations"] = [{"physicalLocation": physical}]
    return result


def _uri(name: str) -> str:
    path = Path(name)
    return path.as_uri() if path.is_absolute() else quote(path.as_posix())
