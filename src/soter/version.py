"""The version of Soter.

Purpose: what files and pages say they were made by.
Non-goals: versions of the language (`soter 1;`).
"""

from __future__ import annotations

VERSION = "0.1.0"
