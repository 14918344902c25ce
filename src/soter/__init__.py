"""Soter: a runtime-assurance framework for robots.

`soter.load("drone.soter")` gives a `Program`; `api/` has its methods. Modules are imported only
when they are used, so `import soter` takes almost no time.

`addons.py` is the table of add-ons, and imports one when somebody uses it; `version.py` has the
version; `__main__.py` is the command line, as `python -m soter`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.version import VERSION

if TYPE_CHECKING:
    from soter.api import CheckReport, Program, ReplayReport, compare, load, recheck, replay
    from soter.diagnostics.diagnostic import SoterError
    from soter.simulate.result import Run

__version__ = VERSION
__all__ = [
    "CheckReport",
    "Program",
    "ReplayReport",
    "Run",
    "SoterError",
    "__version__",
    "compare",
    "load",
    "recheck",
    "replay",
]


def __getattr__(name: str) -> object:
    if name not in __all__:
        raise AttributeError(f"module `soter` has no attribute `{name}`")
    from soter import api  # noqa: PLC0415 - see the docstring

    value: object = getattr(api, name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
