"""Samples through a bridge to DDS, both ways, and what is no sample: lost, misread, refused.

Purpose: peers on Fast DDS and on PyPI's cyclonedds send N samples each through the bridge that
`soter build --target dds` writes, one after the other, each answered before the next; every field
of each is checked on either side. Then the same without the bridge, so that strings and sequences
are checked, too; then other types, cut payloads, random bytes, NaN and infinities.
Non-goals: times (loopback on a busy machine); nodes of ROS 2, of which none is run.

    python bench/ros/dds_samples.py --python VENV/bin/python [--samples 100000]
"""

from __future__ import annotations

import argparse
import random
import struct
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
from bench.ros.dds_fields import TYPES
from bench.ros.dds_peers import Place, missing

PEERS = ("Fast DDS", "cyclonedds-python")
DOMAIN = 77
ODOM = "nav_msgs::msg::dds_::Odometry_"
HEAD = b"\x00\x01\x00\x00"
"""CDR, the lowest byte first."""
NUMBERS = ("nan", "inf", "-inf", "-0x0p+0", "0x1p-1074", "0x1.fffffffffffffp+1023")


def through_the_bridge(place: Place, which: str, samples: int) -> dict[str, Any]:
    """Odometry in and out, then scans in that are answered by Odometry."""
    bridge, harness = place.bridge(), place.harness()
    begun = time.monotonic()
    odom = place.peer(which, "odom", "bridged", "1", str(samples), "rt/odom", "rt/echo", "odom")
    seconds = time.monotonic() - begun
    scans = str(max(samples // 5, 1))
    scan = place.peer(which, "scan", "bridged", "1", scans, "rt/scan", "rt/echo", "odom")
    return {
        "peer": which,
        "seconds_of_odometry": round(seconds, 1),
        "odom": odom,
        "scan": scan,
        "harness": harness.end(),
        "bridge": bridge.end()["topics"],
    }


def over_the_types(place: Place, which: str, samples: int) -> dict[str, Any]:
    """Whole messages, with strings and sequences, both ways."""
    wire = place.start(place.folder / "wire")
    wire.wait_for("wire runs")
    told = {
        key: place.peer(
            which, key, "plain", "1", str(samples), f"rt/{key}_in", f"rt/{key}_out", key
        )
        for key in TYPES
    }
    return {"peer": which, **told, "wire": wire.end()}


def _payloads(rng: random.Random) -> list[bytes]:
    """Cut samples, foreign ones, and bytes that are none."""
    whole = _whole()
    cut = [whole[:n] for n in range(4, len(whole), 7)]
    longer = [whole + bytes(n) for n in (8, 64, 1000)]
    heads = (b"\x00\x03\x00\x00", b"\x00\x02\x00\x00", b"\x00\x07\x00\x00", b"\x7f\x7f\x00\x00")
    foreign = [head + whole[4:] for head in heads]
    twist = HEAD + struct.pack("<6d", *(1.0,) * 6)
    noise = [HEAD + rng.randbytes(rng.randrange(1, 900)) for _ in range(200)]
    texts = [bytearray(whole) for _ in range(3)]
    texts[0][12:16] = struct.pack("<I", 0)  # a text that has not even its end
    texts[1][12:16] = struct.pack("<I", 2**32 - 1)
    texts[2][20] = 7  # a text without an end
    return [*cut, *longer, *foreign, twist, *noise, *(bytes(t) for t in texts), b"", b"\x00"]


def _whole() -> bytes:
    now = time.time_ns()
    body = struct.pack("<iI", now // 10**9, now % 10**9)
    body += struct.pack("<I", 5) + b"odom\0" + b"\0" * 3
    body += struct.pack("<I", 5) + b"body\0" + b"\0" * 3
    return HEAD + body + struct.pack("<85d", *(float(n) for n in range(85)))


def hostile(place: Place) -> dict[str, Any]:
    """Peers of other types, and payloads that are no samples."""
    bridge = place.bridge()
    told: dict[str, Any] = {}
    told["other name"] = _python(place, "other", "name", "rt/odom")
    told["other structure"] = _python(place, "other", "structure", "rt/odom")
    payloads = _payloads(random.Random(1))  # noqa: S311
    file = place.folder / "payloads"
    file.write_bytes(b"".join(struct.pack("<I", len(p)) + p for p in payloads))
    told["payloads"] = place.peer("Fast DDS", "raw", ODOM, "rt/odom", str(file))
    good = place.folder / "good"
    whole = _whole()
    good.write_bytes(struct.pack("<I", len(whole)) + whole)
    told["a good one"] = place.peer("Fast DDS", "raw", ODOM, "rt/odom", str(good))
    status = bridge.end()["topics"]
    said = [line.strip() for line in bridge.said]
    return {**told, "sent": len(payloads), "bridge": status, "said": said}


def numbers(place: Place) -> dict[str, Any]:
    """NaN, infinities and the ends of the floats, as bits in the channel."""
    bridge = place.bridge()
    listed = place.folder / "numbers"
    listed.write_text("\n".join(f"{n} {n}" for n in NUMBERS), encoding="utf-8")
    words = (place.python, Path(__file__).parent / "dds_python_peer.py", "numbers", "rt/odom")
    peer = place.start(*words, listed, place.folder / "types.json")
    same = {}
    assert peer.process.stdin is not None
    assert peer.process.stdout is not None
    for text in NUMBERS:
        peer.process.stdout.readline()
        time.sleep(0.2)
        wanted = struct.pack("<2d", *(2 * (float.fromhex(text),)))
        same[text] = wanted in (place.folder / "channels" / "odom").read_bytes()
        peer.process.stdin.write("\n")
        peer.process.stdin.flush()
    peer.told()
    return {"same_bits": same, "bridge": bridge.end()["topics"]}


def _python(place: Place, *words: str) -> dict[str, Any]:
    script = Path(__file__).parent / "dds_python_peer.py"
    told: dict[str, Any] = place.start(place.python, script, *words).told()
    return told


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--python", default=sys.executable, help="one that has cyclonedds")
    parser.add_argument("--samples", type=int, default=100_000)
    asked = parser.parse_args()
    if missing():
        sys.exit(f"not on this machine: {missing()}")
    with tempfile.TemporaryDirectory() as own:
        place = Place(Path(own), asked.python, DOMAIN)
        place.build()
        print(f"built in {place.folder}", file=sys.stderr, flush=True)
        try:
            told = {
                "bridge": [through_the_bridge(place, p, asked.samples) for p in PEERS],
                "types": [over_the_types(place, p, asked.samples // 5) for p in PEERS],
                "hostile": hostile(place),
                "numbers": numbers(place),
            }
        finally:
            place.end()
    _table(told)
    wrong = _wrong(told)
    print(f"{len(wrong)} of it wrong: {'; '.join(wrong)}" if wrong else "all as it should be")
    sys.exit(1 if wrong else 0)


def _table(told: dict[str, Any]) -> None:
    """What was counted, a line a peer and message."""
    heads = ("sent", "answered", "refused", "lost", "misread")
    print(f"{'':<44}" + "".join(f"{h:>10}" for h in heads))
    for way, runs in (("bridge", "bridge"), ("no bridge", "types")):
        for run in told[runs]:
            for key in TYPES:
                counts = "".join(f"{run[key][h]:>10}" for h in heads)
                print(f"{run['peer'] + ', ' + way + ', ' + key:<44}{counts}")
    h, odom = told["hostile"], told["hostile"]["bridge"][0]
    matched = f"{h['other name']['matched']} and {h['other structure']['matched']}"
    print(f"writers of another name, of another structure, that were matched: {matched}")
    refused = f"{odom['not_readable']} not readable, {odom['of_another_size']} of another size"
    print(f"payloads that mean harm: {h['sent']}, of them {refused}, {odom['taken']} taken, two")
    print("of which are whole: the good one, and its bytes once more as XCDR2")
    same = told["numbers"]["same_bits"]
    print(f"NaN, infinities, the ends of double: {sum(same.values())} of {len(same)} same bits")


def _wrong(told: dict[str, Any]) -> list[str]:
    """What is not as the table has it."""
    found = []
    for run in (*told["bridge"], *told["types"]):
        for key in TYPES:
            of = run[key]
            done = of["answered"] + of["refused"]
            if of["lost"] or of["misread"] or of["unasked"] or done != of["sent"]:
                found.append(f"{run['peer']}, {key}: {of}")
        behind = [run["harness"]] if "harness" in run else [run["wire"][key] for key in TYPES]
        found += [f"{run['peer']}: {b}" for b in behind if b["misread"]]
    odom = told["hostile"]["bridge"][0]
    refused = odom["of_another_size"] + odom["not_readable"]
    if odom["taken"] != 2 or refused < told["hostile"]["sent"] - 3:
        found.append(f"payloads: {odom}")  # taken: the good one, and its bytes as XCDR2
    if odom["peers_of_another_type"] < 2:
        found.append("peers of another type were not counted")
    if not all(told["numbers"]["same_bits"].values()):
        found.append(f"numbers: {told['numbers']['same_bits']}")
    return found


if __name__ == "__main__":
    main()
