"""Robots with five and more states that hang together, drawn by people who did not build `rest`.

    .venv/bin/python bench/tubes/drawn_robots.py            21 robots, ten minutes
    .venv/bin/python bench/tubes/drawn_robots.py --only iris

Purpose: each program of `drawn/` and `designed/` is verified as a user would, what is proved is
re-checked, and the linear estimate of what the declared rest needs
(`verify/tubes/noise_estimate.py`) is printed. The head of each program names the source of its
model. Those of `drawn/` are as their authors drew them before they asked for a proof; authors of
`designed/` changed rests, periods, gains and sensors until a robot was proved or their time ended.
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

FOLDERS = [Path(__file__).parent / name for name in ("drawn", "designed")]


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
    given = ("no", "yes")[module.claims.ac_has_control] if proved else "-"
    row = [path.stem, str(len(check.states)), "proved" if proved else "undecided", given]
    if needs is None:
        return [*row, *"-----"], proved, accepted
    worst = f"{needs.share:.2g} ({check.problem.leaf_of_state(needs.worst)})"
    shares = (f"{x:.2g}" for x in (needs.on_time, needs.young, needs.command))
    return [*row, worst, *shares, str(needs.back or "never")], proved, accepted


def main(arguments: list[str]) -> None:
    """Prints a row for each robot, then the counts."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="", help="robots whose name contains this")
    only = parser.parse_args(arguments).only
    for folder in FOLDERS:
        print(
            f"\n| {folder.name} | states | verdict | AC at the start | noise needs "
            "| commands on time | reads young | SC at ends | back after |\n"
            "|---|---|---|---|---|---|---|---|---|"
        )
        rows = []
        for path in sorted(p for p in folder.glob("*.soter") if only in p.stem):
            rows.append(row_of(path))
            print(f"| {' | '.join(rows[-1][0])} |", flush=True)
        print(f"robots {len(rows)}")
        print(f"proved {sum(proved for _, proved, _ in rows)}")
        print(f"accepted {sum(accepted for *_, accepted in rows)}")


if __name__ == "__main__":
    main(sys.argv[1:])
