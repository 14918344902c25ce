"""Robots with five and more states that hang together, drawn by people who did not build `rest`.

    .venv/bin/python bench/tubes/drawn_robots.py            twelve, ten minutes
    .venv/bin/python bench/tubes/drawn_robots.py --only iris

Purpose: each program of `drawn/` is verified as a user would, what is proved is re-checked, and the
estimate of what noise needs of the declared rest (`verify/tubes/noise_estimate.py`) is printed. The
head of each program names the source of its model.
Non-goals: whether these robots are safe: their authors simulated 300 runs of each, and none left
`safe`.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

import soter
from soter.verify.tubes.noise_estimate import noise_estimate
from soter.verify.tubes.verify import TubeResult

DRAWN = Path(__file__).parent / "drawn"


def row_of(path: Path) -> tuple[list[str], bool, bool]:
    """The row of one robot; whether it is proved, and whether `recheck` accepts the proof."""
    with tempfile.TemporaryDirectory() as folder:
        cert = Path(folder) / "cert"
        report = soter.load(path).verify(cert=cert)
        (module,) = report.modules
        proved = module.verdict in ("proved", "assumed")
        accepted = proved and soter.recheck(cert).accepted
    assert isinstance(module, TubeResult)
    check, needs = module.check, noise_estimate(module.check, module.claims.box)
    row = [path.stem, str(len(check.states)), "proved" if proved else "undecided"]
    if needs is None:
        return [*row, *"----"], proved, accepted
    worst = f"{needs.share:.2g} ({check.problem.leaf_of_state(needs.worst)})"
    shares = (f"{x:.2g}" for x in (needs.on_time, needs.young, needs.command))
    return [*row, worst, *shares], proved, accepted


def main(arguments: list[str]) -> None:
    """Prints a row for each robot, then the counts."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="", help="robots whose name contains this")
    only = parser.parse_args(arguments).only
    print(
        "| robot | states | verdict | noise needs | commands on time | reads young | SC at ends |"
    )
    print("|---|---|---|---|---|---|---|")
    rows = []
    for path in sorted(p for p in DRAWN.glob("*.soter") if only in p.stem):
        rows.append(row_of(path))
        print(f"| {' | '.join(rows[-1][0])} |", flush=True)
    print(f"drawn {len(rows)}")
    print(f"proved {sum(proved for _, proved, _ in rows)}")
    print(f"accepted {sum(accepted for *_, accepted in rows)}")


if __name__ == "__main__":
    main(sys.argv[1:])
