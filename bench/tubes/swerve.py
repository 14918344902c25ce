"""How much longer AC keeps control where SC has several plans, and whether that is safe.

    python bench/tubes/swerve.py [--runs 2000] [--seeds 20]

Purpose: examples/rest/swerve.soter with its three plans and with braking alone: how far before the
parked car AC first loses control, over seeds; then adversarial closed loops of the compiled DM and
SC (`tube_loop.c`): how many touched the car, and how many do where AC always has control.
Non-goals: one tube, instant by instant (`attack.py`).
"""

from __future__ import annotations

import argparse
import re
import sys
import tempfile
from pathlib import Path
from statistics import fmean

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from bench.tubes.attack import ALWAYS_AC, BY_TUBE, SEED  # noqa: E402
from bench.tubes.tube_module import Loop, module_of  # noqa: E402

import soter  # noqa: E402

SWERVE = ROOT / "examples" / "rest" / "swerve.soter"
PARKED = 150.0
"""m, where the parked car begins."""
LONGER = 5.0
"""m, for which AC has to keep control longer with the plans."""


def brakes_alone(text: str) -> str:
    """The program with the first plan alone."""
    alone = re.sub(
        r"node (Left|Right)", r"node _\1", text.replace("sc Brake, Left, Right;", "sc Brake;")
    )
    assert alone != text
    return alone


def lost_m(text: str, seeds: int) -> list[float]:
    """How far it is to the parked car, in m, when AC first loses control, by seed."""
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / "swerve.soter"
        path.write_text(text, encoding="utf-8")
        program, found = soter.load(path), []
        for seed in range(1, seeds + 1):
            run = program.simulate(seed=seed, until="8s", trace=True)
            trace = run.require_trace()
            mode = trace["modules"]["mode"][:, 0]
            row = next(k for k in range(1, len(mode)) if mode[k - 1] == 1 and mode[k] == 0)
            found.append(PARKED - float(trace["topics"]["pose"]["x"][row]))
    return found


def main() -> int:
    """0; 3 where a flight touched something, or AC keeps control for less than 5 m longer."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--runs", type=int, default=2000)
    parser.add_argument("--seeds", type=int, default=20)
    args = parser.parse_args()
    text = SWERVE.read_text(encoding="utf-8")
    plans, alone = lost_m(text, args.seeds), lost_m(brakes_alone(text), args.seeds)
    for name, gaps in (("three plans", plans), ("braking alone", alone)):
        print(f"{name}: {min(gaps):.1f} to {max(gaps):.1f} m in {args.seeds} seeds", flush=True)
    loop = Loop(module_of("swerve.soter", text))
    flown, wild = (loop.run("fly", SEED, args.runs, how) for how in (BY_TUBE, ALWAYS_AC))
    share = flown.in_ac / max(1, flown.in_all)
    print(
        f"AC in control for {share:.1%}; under AC alone {wild.violated:,} of {wild.runs:,} touched"
    )
    longer = fmean(alone) - fmean(plans)
    print(
        f"with three plans AC loses control {fmean(plans):.1f} m before it, with braking alone "
        f"{fmean(alone):.1f} m before it; {flown.violated:,} of {flown.runs:,} adversarial flights "
        "touched something"
    )
    return 0 if flown.violated == 0 and longer > LONGER else 3


if __name__ == "__main__":
    sys.exit(main())
