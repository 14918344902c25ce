"""What can go wrong while a report or a log is written.

Purpose: one type for each thing a caller may want to tell apart.
Non-goals: rendering; the command line turns these into diagnostics.
"""

from __future__ import annotations


class ReportError(Exception):
    """A report could not be written; the message names the file and the cause."""


class ReportUnavailableError(ReportError):
    """The optional package that draws reports is not installed; the message names the extra."""


class LogError(Exception):
    """A log could not be written; nothing stands at its path that did not stand there before."""


class LogUnavailableError(LogError):
    """The optional package that writes logs is not installed; the message names the extra."""
