"""Honest robots with a `rest` clause in the place of their grid: what `verify` and `recheck` say.

    .venv/bin/python bench/newcomers/rest_attempt.py [--folder ../shared/robots] [NAME ...]

Purpose: a row a program: whether rest and the start are proved (the DM then decides in flight), or
the message, CPU seconds of both commands, and what the re-checker says. Of each program the `grid`
and `levels` clauses are taken out, the clause of `RESTS` is written in their place, and nothing
else is changed but, where `verify` says that it was tried and shows rest, `max_age`.
Non-goals: grids (`first_attempt.py`), and whether a rest is the largest there is.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
if str(ROOT) not in sys.path:
    sys.path.insert(0, str(ROOT))

from bench.newcomers.equations import robot_of  # noqa: E402 - needs the path
from bench.newcomers.first_attempt import run  # noqa: E402
from bench.newcomers.flights import lattice, left_by  # noqa: E402
from bench.newcomers.wrong_variants import FLOWN_S, STARTS  # noqa: E402

if TYPE_CHECKING:
    from bench.newcomers.flights import Array, Booleans

RESTS = {
    "boat": "abs(b.y) < 14.0 && abs(b.psi) < 0.55 && abs(b.r) < 0.15 within 20s",
    "car_on_a_lane": "abs(pose.y) < 0.45 && abs(pose.h) < 0.06 within 4s",
    "cruise_control": "abs(seen.v) < 0.3 moves seen.gap by 0.3 down within 8s",
    "differential_drive": "abs(p.v) < 0.05 moves p.x by 0.01, p.y by 0.01 within 4s",
    "dubins_uav": "hypot(pose.x, pose.y) < 100.0 within 60s",
    "emergency_brake": "abs(seen.v) < 0.1 moves seen.gap by 0.02 down within 4s",
    "ground_avoidance": "abs(f.h - 1000.0) < 50.0 && abs(f.g) < 0.13 && abs(f.n - 1.0) < 2.2 "
    "within 5s",
    "hopper": "abs(apex - 0.4) < 0.2 within 4s",
    "lift": "abs(m.h - 15.0) < 4.0 && abs(m.v) < 1.8 && abs(m.a) < 0.8 within 6s",
    "motor": "abs(m.i) < 12.0 && abs(m.w) < 785.0 within 5ms",
    "oven": "abs(temp - 100.0) < 20.0 within 400s",
    "pendulum": "abs(p.a) < 0.1 && abs(p.w) < 0.4 within 3s",
    "six_joints": " && ".join(f"abs(j.q[{k}]) < 0.5 && abs(j.w[{k}]) < 0.5" for k in range(6))
    + " within 700ms",
}
"""Of each robot the smallest clause that was found honest: where its SC ends, and how soon."""
HEAD = "| robot | with `rest` | CPU s | recheck | CPU s | starts in rest that leave its ways |"
FLOWN, POINTS = 3, 9
"""So many times as long as `within` says flights in rest last; starts on each axis."""


def with_rest(text: str, clause: str) -> str:
    """The program with its grid taken out and the clause put before what is left of `verify`."""
    head, verify = re.split(r"\n *verify \{", text)
    block, tail = verify.split("}\n", 1)
    kept = re.sub(r"\b(grid|levels)\b[^;]*;", "", block).strip()
    return f"{head}\n  rest {clause};\n  verify {{ {kept} }}\n{tail}"


def said(document: dict[str, Any]) -> tuple[str, bool]:
    """In words, and whether rest and the start are proved."""
    if not document:
        return "no verdict", False
    errors = [d for d in document.get("diagnostics", []) if d["severity"] == "error"]
    if errors:
        return f"error {errors[0]['code']}: {errors[0]['message']}", False
    (module,) = document["modules"].values()
    found = {name: module["properties"][name] for name in ("P2a", "start")}
    left = [f"{name}: {f['text']}" for name, f in found.items() if f["verdict"] != "proved"]
    return left[0] if left else "rest and start proved", not left


def advised(document: dict[str, Any], text: str) -> tuple[str, str]:
    """What `verify` tried of `max_age` with success, and the program with it; "" where nothing."""
    if not document or not document.get("modules"):
        return "", text
    (module,) = document["modules"].values()
    hint = str(module["properties"]["P2a"].get("hint", ""))
    what = re.search(r"`(max_age \w+)` of `(\w+)` \(tried: rest is shown\)", hint)
    if what is None:
        return "", text
    declared = rf"(topic {what[2]}: .*?)max_age \w+;"
    return f"with {what[1]}: ", re.sub(declared, rf"\1{what[1]};", text)


def flown(name: str, text: str, manifest: Path) -> str:
    """From how many states of the box of rest some flight of SC leaves the ways of the certificate.

    What SC reads is as old as the certificate has it, or new; the simulator knows nothing of tubes.
    """
    (module,) = json.loads(manifest.read_text(encoding="utf-8"))["modules"]
    rest, right = module["rest"], robot_of(text, FLOWN_S[name], STARTS.get(name, {}))
    if rest["moves"] or len(rest["box"]) != len(right.low):
        return "-"
    order = sorted(rest["box"], key=lambda state: text.index(f"state {state.split('.')[1]}:"))
    box, ways = (
        [[float.fromhex(x) for x in rest[what][state]] for state in order]
        for what in ("box", "ways")
    )
    low, high = (np.array(ends)[:, None] for ends in zip(*ways, strict=True))

    def within(x: Array) -> Booleans:
        inside: Booleans = np.logical_and.reduce((x >= low) & (x <= high))
        return inside

    least, most = zip(*box, strict=True)
    robot = replace(
        right,
        low=least,
        high=most,
        safe=within,
        age_s=module["times"]["A_sc_ns"] * 1e-9,
        until_s=FLOWN * rest["within_ns"] * 1e-9,
    )
    start = lattice(robot, POINTS)
    every = [left_by(robot, start, late, -1) for late in (False, True)]
    return f"{np.logical_or.reduce(every).sum()} of {start.shape[1]}"


def main(argv: list[str]) -> int:
    """0."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--folder", type=Path, default=ROOT.parent / "shared" / "robots")
    parser.add_argument("names", nargs="*")
    options = parser.parse_args(argv)
    shown = accepted = 0
    print(f"{HEAD}\n|{'---|' * (HEAD.count('|') - 1)}")
    asked = [name for name in RESTS if not options.names or name in options.names]
    for name in asked:
        text = (options.folder / f"{name}.soter").read_text(encoding="utf-8")
        program = with_rest(text, RESTS[name])
        with tempfile.TemporaryDirectory() as folder:
            os.environ["SOTER_CACHE"] = f"{folder}/cache"  # nothing is known beforehand
            at = Path(folder)
            (at / f"{name}.soter").write_text(program, "utf-8")
            document, cpu_s = run("verify", f"{name}.soter", "--cert", "proof", folder=at)
            verdict, proved = said(document)
            followed, program = advised(document, program)
            if followed and not proved:
                (at / f"{name}.soter").write_text(program, "utf-8")
                document, more_s = run("verify", f"{name}.soter", "--cert", "proof", folder=at)
                verdict, proved = said(document)
                verdict, cpu_s = followed + verdict, cpu_s + more_s
            checked, again_s = run("recheck", "proof", folder=at) if proved else ({}, 0.0)
            flights = flown(name, text, at / "proof" / "manifest.json") if proved else "-"
        shown += proved
        accepted += str(checked.get("verdict")).startswith("accepted")
        again = f"{checked.get('verdict', '-')} | {again_s:.0f}" if checked else "- | -"
        print(f"| {name} | {verdict} | {cpu_s:.0f} | {again} | {flights} |", flush=True)
    print(f"\n{shown} of {len(asked)} proved to rest, {accepted} of these accepted")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
