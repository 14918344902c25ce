"""`python -m soter`: the same as the command `soter`.

Purpose: a command line where the script `soter` is not on the path.
Non-goals: the commands (`cli/`).
"""

from __future__ import annotations

import sys

from soter.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
