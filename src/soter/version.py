"""The version of Soter, and what the Python index calls it.

Purpose: what files and pages say they were made by, and the command that brings what is not there.
Non-goals: versions of the language (`soter 1;`).
"""

from __future__ import annotations

VERSION = "0.1.0"
DISTRIBUTION = "soter-rta"
"""What pip is told; a test holds it, and every page that names it, to `pyproject.toml`."""


def pip_install(extra: str) -> str:
    """The command that brings the packages of an extra."""
    return f"pip install '{DISTRIBUTION}[{extra}]'"
