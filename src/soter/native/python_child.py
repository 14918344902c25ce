"""Python in another process, which imports nothing from the folder that it is started in.

Purpose: the one way in which Soter starts Python. `python -c` and `python -m` look for modules in
the current folder first, and that may be a stranger's; `-P` is not known to Python 3.10, and `-I`
would drop what the person's own PYTHONPATH and site say.
Non-goals: processes that are not Python; what PYTHONPATH names is imported by any Python.
"""

from __future__ import annotations

import sys
from pathlib import Path

START = "import sys; sys.path[:] = [p for p in sys.path if p] + [{root!r}]; "
"""Python puts `""` there for the current folder. `sys` is in it from the start: no file is read."""


ROOT = Path(__file__).resolve().parents[2]
"""Where this Soter is imported from."""


def python_child(code: str, *words: str) -> list[str]:
    """The command that runs this code; `words` are its `sys.argv[1:]`. It imports this Soter."""
    return [sys.executable, "-c", START.format(root=str(ROOT)) + code, *words]


def python_module(name: str, *words: str) -> list[str]:
    """The command that runs a module of an installed package, as `python -m` would."""
    run = f"import runpy; runpy.run_module({name!r}, run_name='__main__', alter_sys=True)"
    return python_child(run, *words)
