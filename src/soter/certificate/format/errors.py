"""What a re-check may say.

Purpose: its three verdicts, and the exceptions behind two of them: for a certificate of which
something is false, and for one of which nothing is known to be, but that is beyond what this room
checks.
Non-goals: what is said of a certificate (`rechecker.py`).
"""

from __future__ import annotations

ACCEPTED, REJECTED, NOT_RECHECKED = VERDICTS = "accepted", "rejected", "not re-checked"
"""All that is claimed holds; something is false; nothing is known to be, but not all is shown."""
FOLLOWED = "its decision module follows SC in flight (`rest`), and its entry does not say so"
"""Why a module with `rest` is not re-checked as others are."""


class RejectedError(Exception):
    """Something that the certificate says is false, or does not show what it is there to show."""


class NotRecheckedError(Exception):
    """The certificate may be right, but needs something that the re-checker does not know or do."""
