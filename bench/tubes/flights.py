"""Flights behind a module with `rest`, every verdict of which is done again from its log.

    .venv/bin/python bench/tubes/flights.py [--flights 100] [--until 20] [--changed 10]

Purpose: prove examples/evidence/follow.soter with an advanced controller that is wild, fly it with
other seeds, and re-check every verdict "AC" of each log in Arb: how many there were, how many were
confirmed, processor time a verdict. In the first logs one verdict is changed then, which has to be
the one that is named.
Non-goals: whether a robot that is decided by the check is safe (`tests/unit/verify/tubes`).
"""

from __future__ import annotations

import argparse
import random
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import soter
from soter.certificate.extras.flight_check import open_flights
from soter.certificate.report import UNCONFIRMED
from soter.report.mcap_log import DECISIONS_TOPIC, MODES_TOPIC, LogChannel, LogHeader, McapLog
from soter.report.mcap_reading import log_messages, log_metadata

if TYPE_CHECKING:
    from types import SimpleNamespace

    from soter.certificate.report import FlightReport

FOLLOW = Path(__file__).resolve().parents[2] / "examples" / "evidence" / "follow.soter"
TOO_FAST = {"gap": 18.0, "way": 0.0, "v": 36.0}
"""Of a train that needs 18 m from where it brakes, which it does not do at once."""
HEAD, REST = "node Cruise period 20ms {", "node Brake"


class Wild:
    """An advanced controller that does anything, in one of four ways that its seed chooses."""

    def reset(self, seed: int) -> None:
        """A way, and what it draws from."""
        self.draw = random.Random(seed)  # noqa: S311 - no secret
        self.way = self.draw.choice(["gas", "random", "switching", "late"])
        self.gas = 1.0

    def step(self, inputs: SimpleNamespace) -> dict[str, dict[str, float]]:
        """Levers within their set."""
        gas, brake = 1.0, 0.0
        if self.way == "random":
            gas, brake = self.draw.random(), self.draw.random()
        elif self.way == "switching":
            if self.draw.random() < 0.05:
                self.gas = 1.0 - self.gas
            gas, brake = self.gas, 1.0 - self.gas
        elif self.way == "late" and inputs.sight.gap > 40.0:
            gas = min(max(0.1 * (30.0 - inputs.sight.v), 0.0), 1.0)
        return {"levers": {"gas": gas, "brake": brake}}


@dataclass
class Flown:
    """What came of a flight; `named`: whether the changed verdict was, None where none was."""

    seed: int
    verdicts: int
    confirmed: int
    said_sc: int
    cpu_s: float
    violations: int
    named: bool | None


def wild_text() -> str:
    """The program, with an AC that is not Soter."""
    text = FOLLOW.read_text(encoding="utf-8")
    begin, end = text.index(HEAD), text.index(REST)
    node = f"extern {HEAD}\n  subscribes sight;\n  publishes levers;\n}}\n"
    return text[:begin] + node + text[end:]


def with_one_changed(log: Path, other: Path, drawn: random.Random) -> int:
    """The log in which one verdict says "AC" of a state that is not good; its time (ns).

    Nothing else contradicts it: the message that it read is changed, too, and so is who has
    control until the next one.
    """
    channels: dict[str, list[tuple[int, Any]]] = {}
    for time_ns, channel, m in log_messages(log):
        channels.setdefault(channel, []).append((time_ns, m))
    steps = channels[DECISIONS_TOPIC]
    at = drawn.randrange(len(steps))
    time_ns, step = steps[at]
    step["mode_after"] = "AC"
    step["predicates"] |= {"ttf": False, "safer": True, "stale": False, "gate_fault": False}
    step["reads"] = {"sight": {"value": TOO_FAST, "age_ns": 0}}
    sights = channels["sight"]
    channels["sight"] = [(t, TOO_FAST if t == time_ns else m) for t, m in sights]
    if at + 1 < len(steps):
        steps[at + 1][1]["mode_before"] = "AC"
    modes = [(0, "SC"), *((t, m["mode_after"]) for t, m in steps)]
    channels[MODES_TOPIC] = [(t, {"module": "Follow", "mode": mode}) for t, mode in modes]
    said = log_metadata(log)
    head = LogHeader(said["program_sha256"], said["system"], int(said["seed"]), "bench")
    schema = {"type": "object", "properties": {}}
    file = McapLog(other, [(name, schema) for name in channels], head)
    with file.dropped_on_error():
        file.add([LogChannel(name, schema, ms) for name, ms in channels.items()])
    file.close()
    return time_ns


def rechecked(certificate: Path, log: Path) -> FlightReport:
    """What a re-check says of a log."""
    flights = open_flights(certificate, [str(log)])
    assert flights is not None
    (report,) = flights.judge_logs()
    return report


def flown(
    program: soter.Program, folder: Path, seed: int, until_s: float, *, change: bool
) -> Flown:
    """One flight, and its verdicts once more; with `change` also those of a changed log."""
    log, other, named = folder / f"{seed}.mcap", folder / f"{seed}-changed.mcap", None
    run = program.simulate(until=f"{until_s}s", seed=seed, log=log)
    report = rechecked(folder / "proof", log)
    if change:
        changed_ns = with_one_changed(log, other, random.Random(seed))  # noqa: S311 - as above
        doubts = rechecked(folder / "proof", other).doubts
        named = [(d.time_ns, d.kind) for d in doubts] == [(changed_ns, UNCONFIRMED)]
        other.unlink()
    log.unlink()
    return Flown(
        seed,
        report.verdicts,
        report.confirmed,
        report.others,
        report.seconds,
        run.violations,
        named,
    )


def main() -> int:
    """Fly and print; 1 where a verdict is not confirmed, or a changed one is not named."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--flights", type=int, default=100)
    parser.add_argument("--until", type=float, default=20.0)
    parser.add_argument("--changed", type=int, default=10)
    args = parser.parse_args()
    every = []
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        path = folder / "wild.soter"
        path.write_text(wild_text(), encoding="utf-8")
        program = soter.load(path)
        program.verify(cert=folder / "proof")
        program.bind("Cruise", Wild())
        for k in range(args.flights):
            every.append(flown(program, folder, 1 + k, args.until, change=k < args.changed))
            print(_line([every[-1]]), flush=True)
    print(f"\nall     {_line(every)}")
    return 0 if all(f.confirmed == f.verdicts and f.named is not False for f in every) else 1


def _line(every: list[Flown]) -> str:
    verdicts, confirmed = sum(f.verdicts for f in every), sum(f.confirmed for f in every)
    each = sum(f.cpu_s for f in every) / max(verdicts, 1)
    named = [f.named for f in every if f.named is not None]
    seed = f"seed {every[0].seed:<4}" if len(every) == 1 else f"{len(every)} flights"
    return (
        f"{seed}  {verdicts:>6,} verdicts AC, {confirmed:>6,} confirmed, {each:.3f} s of CPU each, "
        f"{sum(f.said_sc for f in every):>6,} SC, {sum(f.violations for f in every)} violations, "
        f"{named.count(True)} of {len(named)} changed logs named"
    )


if __name__ == "__main__":
    sys.exit(main())
