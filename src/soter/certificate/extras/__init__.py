"""What most certificates have not. The contract: the core imports this package, and no file of it.

Purpose: `extras.NAME` imports the file of that name, where a certificate uses it, so that one
without extras rests on none (a test). docs/recheck.md says which feature each is of.
Non-goals: methods that prove whole modules (`proof_methods.py`).
"""

from importlib import import_module
from typing import Any


class _Extras:
    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - whoever asks says what it has
        return import_module(f"{__name__}.{name}")


extras = _Extras()
