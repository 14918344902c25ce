"""What most certificates have not, each in a file of its own.

The contract: the core, that of grids too, imports this package, and no file of it. The other
methods, and other rooms, import files.

Purpose: `extras.NAME` imports the file of that name, where a certificate uses it, so that one
without extras rests on none (a test). docs/recheck.md says which feature each is of.
Non-goals: methods that prove whole modules (`proof_methods.py`).

- Flights: `flight_check.py` checks verdicts in logs, `flight_assumptions.py` the assumptions.
- Plants: `maps.py` for those that step; `left_out_states.py`: states that no claim looks at.
- SC: `sc_locals_and_modes.py` for locals and modes of others; `failsafe_law.py` for the law in its
  place; `resting.py`: cells from which it only comes to rest.
- Terms: `prelude_functions.py` encloses `sin` and its like, `array_elements.py` elements of arrays.
- DMs: `estimates_and_shield.py` for computed predicates and shields.
- Times: `node_paths.py` for nodes on the way to a module, `thread_times.py` for the thread.
- Views: `views.py` reads modules in views or on abstractions, `handovers.py` checks `enters`.
- `trial.py` tells `verify`, beforehand, whether a certificate would be re-checked.
"""

from importlib import import_module
from typing import Any


class _Extras:
    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - whoever asks says what it has
        return import_module(f"{__name__}.{name}")


extras = _Extras()
