"""The version of Soter, and what the Python index calls it.

Purpose: what files and pages say they were made by, and the command that brings what is not there.
Non-goals: versions of the language (`soter 1;`).
"""

from __future__ import annotations

import sys
from importlib.util import find_spec
from pathlib import Path


def other_format(given: object, read: int) -> str:
    """Why a file of format `given` is not read, as a clause; "" where it is the format `read`."""
    if given == read and type(given) is int:
        return ""
    if type(given) is not int:
        return "it does not say the version of its format"
    age = "an older" if given < read else "a newer"
    return f"its format is {given}, of {age} soter, and this one reads format {read}"


VERSION = "1.0.0"
DISTRIBUTION = "soter-rta"
"""The name on the Python index; a test compares it, and each page with it, to `pyproject.toml`."""


def pip_install(extra: str) -> str:
    """The command that brings the packages of an extra to the Python that runs this.

    It says `pip` alone where the shell's `pip` is this Python's own; pipx and uv keep Soter where
    that `pip` does not install, and an environment of uv has no pip at all.
    """
    import shlex  # noqa: PLC0415 - needed only where a package is missing
    import shutil  # noqa: PLC0415 - the same

    wanted, python = f"'{DISTRIBUTION}[{extra}]'", shlex.quote(sys.executable or "python")
    if find_spec("pip") is None:
        return f"uv pip install --python {python} {wanted}"
    found = shutil.which("pip")
    own = found is not None and Path(found).parent == Path(sys.executable).parent
    return f"{'pip' if own else f'{python} -m pip'} install {wanted}"
