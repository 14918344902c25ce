"""Soter: a runtime-assurance framework for robots.

`soter.load("drone.soter")` gives a `Program`; what it can do stands in `soter/api/`. Nothing
is imported before it is used: `import soter` costs next to nothing.
"""

from __future__ import annotations

import sys
from types import ModuleType
from typing import TYPE_CHECKING

from soter.version import VERSION

if TYPE_CHECKING:
    from soter.api import CheckReport, Program, ReplayReport, load, recheck, replay
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


class _Checker(ModuleType):
    """The package `soter.recheck`, which is called as the function of that name as well."""

    def __call__(self, *arguments: object, **named: object) -> object:
        from soter import api  # noqa: PLC0415 - see the docstring

        return api.recheck(*arguments, **named)  # type: ignore[arg-type]


class _Soter(ModuleType):
    """This package. Importing `soter.recheck` puts the package in the place of the function."""

    def __setattr__(self, name: str, value: object) -> None:
        if name == "recheck" and isinstance(value, ModuleType):
            value.__class__ = _Checker
        super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Soter
