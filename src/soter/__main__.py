"""Runs the command `soter` as `python -m soter`.

Purpose: a command line where the script `soter` is not on the path.
Non-goals: the commands (`cli/`).
"""

from __future__ import annotations

import os
import sys

if __name__ == "__main__" and sys.path[:1] == [os.getcwd()]:  # noqa: PTH109 - text
    del sys.path[0]  # `python -m` puts the current folder first

from soter.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
