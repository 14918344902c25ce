"""Fly in unknown space and write a page on which the map grows.

    python examples/exploration/replay.py [--file FILE] [--system NAME] [-o exploration.html]

Purpose: the picture of the paper's last case study, of any program with the map of mapper.soter:
what was known when, who was in control, which box was in force.
Non-goals: many flights (bench/exploration).
"""

from __future__ import annotations

import argparse
import shlex
import sys
from pathlib import Path

from exploration_page import page, picture, quantities
from exploration_record import HERE, NEEDED, fly, topics_of

import soter
from soter.report.html import write_text


def arguments() -> argparse.ArgumentParser:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--file", type=Path, default=HERE / "exploration.soter")
    parser.add_argument("--system", help="by default that of the file")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--until", default="120s", help="such as 30s or 10min (default: 120s)")
    parser.add_argument("-o", "--output", type=Path, default=Path(".soter") / "exploration.html")
    parser.add_argument("--svg", type=Path, help="write the last picture there, too")
    return parser


def main() -> None:
    """Fly, print, write; exit code 3 where a property was violated."""
    parser = arguments()
    options = parser.parse_args()
    program = soter.load(str(options.file))
    missing = [name for name in NEEDED if name not in topics_of(program, options.system)]
    if missing:
        parser.error(f"{options.file} explores nothing: it has no topic {', '.join(missing)}")
    explored = fly(program, options.system, seed=options.seed, until=options.until)
    for what, text in quantities(explored).items():
        print(f"  {what:32} {text}")
    command = shlex.join(["python", "examples/exploration/replay.py", *sys.argv[1:]])
    options.output.parent.mkdir(parents=True, exist_ok=True)
    write_text(page(explored, command), options.output)
    if options.svg is not None:
        write_text(picture(explored), options.svg)
    print(f"wrote {', '.join(str(p) for p in (options.output, options.svg) if p is not None)}")
    sys.exit(3 if explored.run.violations else 0)


if __name__ == "__main__":
    main()
