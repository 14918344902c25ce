"""The version of Soter, and what the Python index calls it.

Purpose: the version that files and pages name, and the command that installs missing packages.
Non-goals: versions of the language (`soter 1;`).
"""

from __future__ import annotations

import sys
from importlib.util import find_spec
from pathlib import Path


def why_format_is_unreadable(found: object, known: int) -> str:
    """A clause that says why format `found` cannot be read; "" if `found` equals `known`."""
    if found == known and type(found) is int:
        return ""
    if type(found) is not int:
        return "it does not say the version of its format"
    age = "an older" if found < known else "a newer"
    return f"its format is {found}, of {age} soter, and this one reads format {known}"


VERSION = "1.0.0"
DISTRIBUTION = "soter-rta"
"""The name on the Python index; a test compares it, and each page with it, to `pyproject.toml`."""


def pip_command(extra: str) -> str:
    """The shell command that installs the packages of an extra for the Python that runs Soter.

    The command is plain `pip` only if the shell's `pip` belongs to this Python: under pipx and uv
    the shell's `pip` installs elsewhere. An environment of uv has no pip, and gets `uv pip`.
    """
    import shlex  # noqa: PLC0415 - needed only where a package is missing
    import shutil  # noqa: PLC0415 - the same

    wanted, python = f"'{DISTRIBUTION}[{extra}]'", shlex.quote(sys.executable or "python")
    if find_spec("pip") is None:
        return f"uv pip install --python {python} {wanted}"
    pip_path = shutil.which("pip")
    same_python = pip_path is not None and Path(pip_path).parent == Path(sys.executable).parent
    return f"{'pip' if same_python else f'{python} -m pip'} install {wanted}"
