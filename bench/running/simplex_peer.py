"""A decision and its gate against run-time-assurance's switching filter, states of one range.

    python -m venv PEER && PEER/bin/pip install run-time-assurance==1.18.6
    .venv/bin/python bench/running/simplex_peer.py --peer PEER/bin/python

Purpose: one call of theirs (state and wish in, control out) against one turn of a loop of ours:
both published and checked, DM, SC and AC stepped, the control read, in C through the interface of
docs/deploy.md; and against the Python door, a step of an environment with the module in front less
one of the environment alone. In turns, medians. JAX is heavy, so the peer has its own environment.
Non-goals: whose answers are better: theirs is checked one step ahead for the control that was asked
for, ours for any control two periods ahead.
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

import soter
from soter.gym import Protected
from soter.native.compiler import STRICT, find
from soter.native.shared_library import CHECK_FAILED

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = ROOT / "bench" / "running" / "docking.soter"
TARGET_C, TARGET_PYTHON = 400.0, 50.0
STATES, ROUNDS = 2000, 5
PEER = """
import sys, time
import numpy as np
from run_time_assurance.zoo.integrators.integrator_1d import Integrator1dDockingExplicitSwitchingRTA
rta = Integrator1dDockingExplicitSwitchingRTA()
rng = np.random.default_rng(1)
calls = [(np.array([-rng.uniform(0, 10), rng.uniform(-2, 4)]), np.array([rng.uniform(-1, 1)]))
         for _ in range(500)]
for state, wish in calls:
    rta.filter_control(state, 0.1, wish)
for _ in sys.stdin:
    began = time.perf_counter()
    for state, wish in calls:
        rta.filter_control(state, 0.1, wish)
    print((time.perf_counter() - began) / len(calls) * 1e9, flush=True)
"""
LOOP = """
#include <stdio.h>
#include <time.h>
#include "Loop_firmware.h"
static Loop loop;
static int64_t clock_ns(void) {
  struct timespec t;
  (void)clock_gettime(CLOCK_MONOTONIC, &t);
  return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}
int main(void) {
  const long turns = 1000000;
  int64_t now = 0;
  double push = 0.0;
  int c;
  if (Loop_start(&loop, now) != NULL) { return 1; }
  while ((c = getchar()) != EOF) {
    if (c != '\\n') { continue; }
    double sum = 0.0;
    long braked = 0;
    uint64_t bits = 88172645463325252u;
    const int64_t began = clock_ns();
    for (long i = 0; i < turns; i++) {
      bits ^= bits << 13; bits ^= bits >> 7; bits ^= bits << 17;
      const double u = (double)(bits >> 11) * 0x1p-53;
      const Loop_craft craft = {-10.0 * u, 6.0 * (double)((bits >> 5) % 1000u) / 1000.0 - 2.0};
      (void)Loop_publish_craft(&loop, &craft, now, now);
      (void)Loop_publish_wanted(&loop, 2.0 * u - 1.0, now, now);
      (void)Loop_step(&loop, now);
      (void)Loop_read_push(&loop, &push, NULL);
      sum += push;
      braked += Loop_mode_Docking(&loop) == SOTER_SC;
      now += 100000000;
    }
    const int64_t took = clock_ns() - began;
    printf("%.3f %.6f %.6f\\n", (double)took / (double)turns, (double)braked / (double)turns, sum);
    fflush(stdout);
  }
  return 0;
}
"""


class Craft(gymnasium.Env[Any, Any]):
    """The craft alone: x, v in m and m/s, a thrust in [-1, 1]."""

    action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float64)
    observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (2,), np.float64)

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:  # noqa: ANN401
        """At rest, 5 m before the dock."""
        super().reset(seed=seed, options=options)
        self.x, self.v = -5.0, 0.0
        return np.array([self.x, self.v]), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:  # noqa: ANN401
        """A tenth of a second."""
        u = float(action[0])
        self.x, self.v = self.x + 0.1 * self.v + 0.005 * u, self.v + 0.1 * u
        return np.array([self.x, self.v]), 0.0, False, False, {}


def built(folder: Path) -> Path:
    """The loop in C."""
    soter.load(PROGRAM).build("c", folder)
    source = folder / "peer.c"
    source.write_text(LOOP, encoding="utf-8")
    left = {"main.c", "soter_app.c", "peer.c"}
    files = [str(f) for f in sorted(folder.glob("*.c")) if f.name not in left]
    program = folder / "peer"
    flags = [*STRICT, "-D_POSIX_C_SOURCE=199309L", "-O2", f"-I{folder}"]
    command = [*find().command, *flags, str(source), *files, str(CHECK_FAILED)]
    subprocess.run([*command, "-lm", "-o", str(program)], check=True)
    return program


def steps(env: gymnasium.Env[Any, Any]) -> float:
    """A step of an environment, ns."""
    action = np.array([0.5])
    env.reset(seed=1)
    count = 0
    began = time.perf_counter()
    while count < STATES:
        _, _, ended, cut, _ = env.step(action)
        count += 1
        if ended or cut:
            env.reset(seed=1)
    return (time.perf_counter() - began) / count * 1e9


def asked(peer: subprocess.Popen[str]) -> list[str]:
    """One round of a process that answers a line with a line."""
    assert peer.stdin is not None
    assert peer.stdout is not None
    peer.stdin.write("\n")
    peer.stdin.flush()
    return peer.stdout.readline().split()


def main() -> int:
    """Measure in turns; 1 where the ratio in C is below its target, 2 without the peer."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--peer", default=sys.executable, help="a Python with run-time-assurance")
    args = parser.parse_args()
    there = subprocess.run(
        [args.peer, "-c", "import run_time_assurance"], capture_output=True, check=False
    )
    if there.returncode:
        print(f"`{args.peer}` has no run-time-assurance: see --help of this file")
        return 2
    ours: list[float] = []
    theirs: list[float] = []
    python: list[float] = []
    with tempfile.TemporaryDirectory() as place:
        how: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
        program = built(Path(place) / "c")
        bare, protected = Craft(), Protected(PROGRAM, Craft(), system="Trained")
        with (
            subprocess.Popen([str(program)], **how) as loop,
            subprocess.Popen([args.peer, "-c", PEER], **how) as peer,
        ):
            asked(peer)
            for _ in range(ROUNDS):
                theirs.append(float(asked(peer)[0]))
                turn = asked(loop)
                ours.append(float(turn[0]))
                python.append(steps(protected) - steps(bare))
            for process in (loop, peer):
                assert process.stdin is not None
                process.stdin.close()
    c, door, peers = (statistics.median(x) for x in (ours, python, theirs))
    print(f"run-time-assurance 1.18.6, explicit switching, docking on a line: {peers / 1e3:.1f} us")
    print(f"soter, C: publish, publish, step, read:                           {c:.0f} ns "
          f"(SC in control in {float(turn[1]):.0%} of the turns)")  # fmt: skip
    print(f"soter, Python: a protected step less a bare one:                  {door / 1e3:.1f} us")
    good = peers / c >= TARGET_C
    print(
        f"C: {peers / c:,.0f} x  target >= {TARGET_C:g} (goal 2,000): {'ok' if good else 'missed'}"
    )
    fine = peers / door >= TARGET_PYTHON
    print(
        f"Python: {peers / door:.1f} x  target >= {TARGET_PYTHON:g}: {'ok' if fine else 'missed'}"
    )
    return 0 if good and fine else 1


if __name__ == "__main__":
    sys.exit(main())
