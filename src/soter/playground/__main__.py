"""`python -m soter.playground -o DIR`: write the page.

Purpose: the command line of `make playground`.
Non-goals: serving it. It is no command of `soter`: nobody needs it twice a day.
"""

from __future__ import annotations

import argparse
import sys

from soter.diagnostics.diagnostic import SoterError
from soter.diagnostics.render import render_all
from soter.playground.write import write_playground


def main() -> int:
    """Writes the page of the playground; gives 1 if that fails."""
    parser = argparse.ArgumentParser("python -m soter.playground", description=__doc__)
    parser.add_argument("-o", "--output", metavar="DIR", required=True, help="gets index.html")
    parser.add_argument("--pyodide", metavar="PATH", help="the npm package, or its folder")
    parser.add_argument("--examples", metavar="DIR", help="programs to offer; by default a cart")
    args = parser.parse_args()
    try:
        path = write_playground(args.output, args.pyodide, args.examples)
    except SoterError as error:
        print(render_all(error.diagnostics), file=sys.stderr)
        return 1
    print(f"page  {path}  {path.stat().st_size / 1e6:.1f} MB, all in one file")
    return 0


if __name__ == "__main__":
    sys.exit(main())
