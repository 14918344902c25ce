"""Robots that come in several topics, each of which falls silent by itself.

    python bench/adversary/topics_apart.py --programs 40 --flights 200

Purpose: programs are drawn whose plants drive two to four topics, and kept where P2a, P3 and start
are proved (or P2a and start, with `rest`). Each is flown with an AC that rushes at the border of
`safe` while its topics fall silent, one by one, as long as `max_age` and `dropout` allow: a
violation is a wrong proof. Of each program with `rest` flights that break a printed assumption are
logged and asked of its certificate: one that shows the break and is CONFIRMED is wrong.
Non-goals: other adversaries (`closed_loop.py`, `../tubes/attack.py`), time.
"""

from __future__ import annotations

import argparse
import random
import sys
import tempfile
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

from mcap.reader import make_reader

from soter import load, recheck
from soter.diagnostics.diagnostic import SoterError
from soter.language.front_end import check_file, system_of
from soter.simulate.run import NativeProgram
from soter.verify.deploy.missing_predicates import complete

SECOND = 10**9
FLOWN_S = 12
HEAD = """soter 1;
{topics}
topic u: float in {set};
topic brake: float in [0.0, 1.0] = 1.0;
node Rush period 20ms {{ publishes u, brake; step {{ publish u = {rush}; publish brake = 0.0; }} }}
node Safe period {delta}ms {{
  {reads}publishes u, brake;
  step {{ publish u = {law}; publish brake = 1.0; }}
}}
rta M {{
  ac Rush;
  sc Safe;
  period {delta_dm}ms;
  safe {safe};
  {proof}
}}
plant P period {step}ms {{
  reads u, brake;
  {drives}
  {states}
  {rates}
  measured {measured};
}}
system S default {{
  p: P;
  module M;
  until {flown}s;
  always {truth};
  {faults}
}}
"""
BREAKS = {
    "silent for longer": "silent p.{topic} at 20 per 60s for {beyond}ms;",
    "SC late": "late M.Safe by {delta}ms at 30 per 60s;",
    "SC skips": "skip M.Safe at 30 per 60s;",
    "DM late": "late M.dm by 15ms at 60 per 60s;",
    "DM skips": "skip M.dm at 60 per 60s;",
}


@dataclass(frozen=True)
class Drawn:
    """A program: its text with a place for faults, its topics, and whether it has `rest`."""

    text: str
    topics: tuple[str, ...]
    dropout_ms: int
    delta_ms: int
    rests: bool

    def with_faults(self, faults: str) -> str:
        """The program with these faults in its system."""
        return self.text.replace("FAULTS", f"faults {{ {faults} }}" if faults else "")

    def silences(self) -> str:
        """Each topic silent by itself, as long as it may be."""
        of_each = f"at 15 per 60s for {self.dropout_ms}ms;"
        return " ".join(f"silent p.{t} {of_each}" for t in self.topics)


def drawn(rng: random.Random) -> Drawn:
    """A braking car, a car with a slow pedal, two tanks, or a mass that is held in the middle."""
    kind = rng.choice(("brake", "pedal", "tanks", "mass"))
    step = rng.choice((5, 10))
    delta, delta_dm = rng.choice(((20, 40), (50, 50), (20, 100)))
    dropout = step * rng.randint(2, {"brake": 100, "pedal": 60, "tanks": 40, "mass": 6}[kind])
    ages = [max(delta, delta_dm) + step + rng.choice((0, dropout, 10)) for _ in range(4)]
    wall, speed = rng.choice((120.0, 200.0)), rng.choice((8.0, 16.0))
    stop, push = rng.choice((2.0, 4.0)), rng.choice((0.1, 0.5))
    if kind in ("brake", "pedal"):
        lag = kind == "pedal"
        names = ("place", "speed", "pedal")[: 3 if lag else 2]
        states = f"state x: float in [40.0, 60.0]; state v: float = {speed};"
        states += " state f: float = 1.0;" if lag else ""
        brakes = f"{stop} * {'f' if lag else 'brake'} * v / (abs(v) + 0.1)"
        rates = f"der x = v; der v = {push} * u - {brakes};"
        rates += " der f = 5.0 * (brake - f);" if lag else ""
        rest = "rest abs(speed) < 0.3" + (" && pedal > 0.9" if lag else "")
        parts = {
            "set": "[0.0, 1.0]",
            "rush": "1.0",
            "reads": "",
            "law": "0.0",
            "safe": f"place < {wall}",
            "truth": f"p.truth.x < {wall}",
            "proof": f"{rest} moves place by 0.2 within {20 if lag else 30}s;",
        }
        values = dict(zip(names, ("x", "v", "f"), strict=False))
        sets = {"speed": " in [-2.0, 60.0]", "pedal": " in [-0.1, 1.1]"}
    elif kind == "tanks":
        names = ("left", "right", "sum")[: rng.choice((2, 3))]
        states = "state a: float in [-1.0, 1.0]; state b: float in [-1.0, 1.0];"
        slow = rng.choice((0.2, 0.5))
        rates = f"der a = {speed / 8.0} * u + 0.0 * brake; der b = u - {slow} * b;"
        parts = {
            "set": "[-1.0, 1.0]",
            "rush": "1.0",
            "reads": "subscribes left; ",
            "law": f"clamp(-{rng.choice((0.5, 1.0, 2.0))} * left, -1.0, 1.0)",
            "safe": "abs(left) < 6.0 && abs(right) < 6.0",
            "truth": "abs(p.truth.a) < 6.0 && abs(p.truth.b) < 6.0",
            "proof": "",
        }
        values = dict(zip(names, ("a", "b", "a + b"), strict=False))
        sets = {}
        grid = "grid left in [-6.5, 6.5] / 65, right in [-6.5, 6.5] / 65;"
    else:
        names = ("place", "speed")
        states = "state x: float in [-0.5, 0.5]; state v: float in [-0.2, 0.2];"
        rates = "der x = v; der v = u + 0.0 * brake;"
        gain = rng.choice((0.4, 0.8))
        parts = {
            "set": "[-1.0, 1.0]",
            "rush": rng.choice(("1.0", "-1.0")),
            "reads": "subscribes place, speed; ",
            "law": f"clamp(-{gain} * place - {rng.choice((1.2, 1.8))} * speed, -1.0, 1.0)",
            "safe": "abs(place) < 8.0",
            "truth": "abs(p.truth.x) < 8.0",
            "proof": "",
        }
        values = dict(zip(names, ("x", "v"), strict=True))
        sets = {}
        grid = "grid place in [-8.2, 8.2] / 110, speed in [-4.0, 4.0] / 90;"
    rests = bool(parts["proof"])
    parts["proof"] += f" verify {{ dropout {dropout}ms; {'' if rests else grid} }}"
    text = HEAD.format(
        topics="\n".join(
            f"topic {n}: float{sets.get(n, '')} max_age {age}ms;"
            for n, age in zip(names, ages, strict=False)
        ),
        drives=" ".join(f"drives {n} = {of};" for n, of in values.items()),
        states=states,
        rates=rates,
        measured=", ".join(f"{n} within 0.001" for n in names if n != "sum"),
        delta=delta,
        delta_dm=delta_dm,
        step=step,
        flown=FLOWN_S,
        faults="FAULTS",
        **parts,
    )
    return Drawn(text, names, dropout, delta, rests)


def proved(path: Path, cert: Path | None) -> bool:
    """Whether all that safety needs is proved of its module; a certificate of it is written."""
    try:
        (module,) = load(path).verify(cert=cert, refute=False).modules
    except SoterError:
        return False
    names = ("P2a", "start") if "rest" in path.read_text() else ("P2a", "P3", "start")
    return all(module.findings[n].verdict == "proved" for n in names)


def violated(path: Path, flights: int) -> list[int]:
    """The seeds of flights that end in a violation."""
    flat = system_of(check_file(str(path)), "S")
    complete(flat)
    native = NativeProgram(flat)
    return [k for k in range(flights) if native.run(FLOWN_S * SECOND, k).violations]


def messages(log: Path) -> list[tuple[str, int, bytes]]:
    """Topic, time in ns and bytes of every message of a log."""
    with log.open("rb") as file:
        every = make_reader(file).iter_messages()
        return [(channel.topic, m.log_time, m.data) for _, channel, m in every]


def confirmed_all_the_same(program: Drawn, folder: Path, told: Counter[str]) -> list[str]:
    """The breaks of which a flight shows one and is confirmed; `told` counts what was said."""
    wrong = []
    path, log = folder / "robot.soter", folder / "flight.mcap"
    path.write_text(program.with_faults(""))
    load(path).simulate(seed=1, until=f"{FLOWN_S}s", log=log)
    untouched = messages(log)
    for what, fault in BREAKS.items():
        beyond = 2 * program.dropout_ms + 40
        faults = fault.format(topic=program.topics[-1], beyond=beyond, delta=program.delta_ms)
        path.write_text(program.with_faults(faults))
        cert = folder / f"cert {what}"
        if not proved(path, cert):
            continue
        load(path).simulate(seed=1, until=f"{FLOWN_S}s", log=log)
        if messages(log) == untouched:
            told[f"{what}: no message shows it"] += 1
            continue
        (report,) = recheck(cert, logs=[log]).flights
        told[f"{what}: {report.verdict}"] += 1
        wrong += [what] * (report.verdict == "accepted")
    return wrong


def main() -> None:
    """Print a row, and fail where a flight was violated or a broken assumption confirmed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--programs", type=int, default=40)
    parser.add_argument("--flights", type=int, default=200)
    parser.add_argument("--seed", type=int, default=72)
    args = parser.parse_args()
    rng = random.Random(args.seed)  # noqa: S311 - it draws programs
    kept = tried = bad = flown = 0
    wrong: list[str] = []
    told: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "robot.soter"
        while kept < args.programs:
            program = drawn(rng)
            tried += 1
            path.write_text(program.with_faults(program.silences()))
            if not proved(path, None):
                continue
            kept += 1
            seeds = violated(path, args.flights)
            flown += args.flights
            bad += len(seeds)
            if seeds:
                print(f"violated: program {tried}, seeds {seeds[:5]}\n{program.text}", flush=True)
            if program.rests:
                wrong += confirmed_all_the_same(program, Path(name), told)
            print(f"{tried:4} {'rest' if program.rests else 'grid'} {program.topics}", flush=True)
    print(f"programs proved, of drawn: {kept} of {tried}")
    print(f"flights, topics silent one by one: violated: {bad} of {flown:,} (target 0)")
    shown = sum(n for what, n in told.items() if not what.endswith("shows it"))
    confirmed = f"{len(wrong)} of {shown} (target 0)"
    print(f"flights that break what is printed: CONFIRMED: {confirmed}")
    for what, count in sorted(told.items()):
        print(f"  {what}: {count}")
    sys.exit(bool(bad or wrong))


if __name__ == "__main__":
    main()
