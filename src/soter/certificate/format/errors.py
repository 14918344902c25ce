"""What a re-check says no to.

Purpose: the exception for a certificate that does not show what it claims.
Non-goals: what could not be understood (`terms/terms.py`: `NotRecheckedError`).
"""

from __future__ import annotations


class RejectedError(Exception):
    """A claim of the certificate could not be confirmed."""
