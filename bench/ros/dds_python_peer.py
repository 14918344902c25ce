"""A peer on PyPI's `cyclonedds`, in an interpreter of its own: it knows nothing of Soter.

Purpose: sends the k-th sample on one topic, waits for the answer with k on another and checks every
field of it; or is a peer of another type. Words: KEY bridged|plain FROM COUNT SEND HEAR ANSWER_KEY
FILE, or other NAME|STRUCTURE TOPIC, or numbers TOPIC FILE.
FILE: the definitions of rosbags, as JSON.
Non-goals: counting for others.
"""

# ruff: noqa: ANN401
from __future__ import annotations

import json
import os
import sys
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
from bench.ros.dds_fields import COUNTERS, TYPES, Field, fields, value
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import make_idl_struct
from cyclonedds.idl import types as t
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

IDL: Any = t
PRIMITIVES = {
    "bool": bool,
    "byte": t.byte,
    "string": str,
    "char": t.uint8,
    **{n: getattr(t, n) for n in ("float32", "float64")},
    **{f"{u}int{n}": getattr(t, f"{u}int{n}") for u in ("", "u") for n in (8, 16, 32, 64)},
}
CHILDREN = ("base_link", "body", "arm")
RELIABLE = Qos(Policy.Reliability.Reliable(duration(seconds=10)), Policy.History.KeepAll)


def type_of(name: str, given: dict[str, Any], made: dict[str, type]) -> type:
    """The class of a message, members named as in the IDL of ROS 2."""
    if name in made:
        return made[name]
    members = {}
    for member, kind in given[name]:
        members[f"{member}_"] = _member(kind, given, made)
    package, _, last = name.split("/")
    made[name] = make_idl_struct(f"{last}_", f"{package}.msg.dds_.{last}_", members)
    return made[name]


def _member(kind: Any, given: dict[str, Any], made: dict[str, type]) -> Any:
    if kind[0] == 1:
        return PRIMITIVES[kind[1][0]]
    if kind[0] == 2:
        return type_of(kind[1], given, made)
    element, size = kind[1]
    inner = _member(element, given, made)
    return IDL.array[inner, size] if kind[0] == 3 else IDL.sequence[inner]


def made_of(key: str, k: int, found: list[Field], kinds: dict[str, type], given: Any) -> Any:
    """The k-th sample."""
    values = {f.path: value(f, key, k) for f in found}
    return _built(TYPES[key], values, (), kinds, given)


def _built(name: str, values: Any, before: tuple[str, ...], kinds: Any, given: Any) -> Any:
    members = {}
    for member, kind in given[name]:
        path = (*before, member)
        members[f"{member}_"] = (
            _built(kind[1], values, path, kinds, given) if kind[0] == 2 else values[path]
        )
    return kinds[name](**members)


def read(m: Any, path: tuple[str, ...]) -> Any:
    """A field of a sample."""
    for part in path:
        m = getattr(m, f"{part}_")
    return m


def wrong(m: Any, key: str, k: int, found: list[Field], bridged: bool) -> str:
    """The first field that is not as it should be."""
    for f in found:
        is_ = read(m, f.path)
        if bridged and f.name.startswith("header.stamp"):
            continue
        if bridged and f.primitive == "string":
            should: Any = CHILDREN[k % 3] if f.name == "child_frame_id" else "odom"
        else:
            should = value(f, key, k)
        if (list(is_) if f.many else is_) != should:
            return f.name
    return ""


def stamp(m: Any) -> int:
    """Put now into a sample; ns."""
    now = time.time_ns()
    m.header_.stamp_.sec_, m.header_.stamp_.nanosec_ = divmod(now, 10**9)
    m.header_.frame_id_ = "odom"
    return now


def exchange(words: list[str]) -> dict[str, object]:
    key, how, begin, count, to, at, answer_key, file = words
    bridged, given = how == "bridged", json.loads(Path(file).read_text(encoding="utf-8"))
    kinds: dict[str, type] = {}
    sent, heard = (type_of(TYPES[n], given, kinds) for n in (key, answer_key))
    found = {n: fields(TYPES[n], given) for n in (key, answer_key)}
    own = DomainParticipant(int(os.environ["ROS_DOMAIN_ID"]))
    w: DataWriter[Any] = DataWriter(own, Topic(own, to, sent), qos=RELIABLE)
    r: DataReader[Any] = DataReader(own, Topic(own, at, heard), qos=RELIABLE)
    counter = tuple(COUNTERS[answer_key].split("."))
    told = {"sent": int(count), "answered": 0, "refused": 0, "lost": 0, "misread": 0, "unasked": 0}
    first, off, warm, tries, k = "", 0, False, 0, int(begin)
    time.sleep(2.0)  # both sides have to know each other
    while k < int(begin) + int(count):
        m = made_of(key, k, found[key], kinds, given)
        asked = stamp(m) if bridged else 0
        if bridged and key == "odom":
            m.child_frame_id_ = CHILDREN[k % 3]
        w.write(m)
        if bridged and key == "scan" and len(m.ranges_) < 8:
            told["refused"] += 1
            k += 1
            continue
        there = False
        end = time.monotonic() + 3.0
        while not there and time.monotonic() < end:
            a = next(r.take_iter(timeout=duration(seconds=1)), None)
            if a is None:
                break
            got = int(read(a, counter))
            bad = wrong(a, answer_key, got, found[answer_key], bridged)
            told["misread"] += bool(bad)
            first = first or bad
            there = got == k
            told["unasked"] += got != k
            if bridged and there and warm:
                d = a.header_.stamp_.sec_ * 10**9 + a.header_.stamp_.nanosec_ - asked
                off = max(off, abs(d))
        if not there and not warm and tries < 20:
            tries += 1
            continue
        warm = True
        told["answered"] += there
        told["lost"] += not there
        k += 1
    time.sleep(0.3)
    return {**told, "first": first, "stamp_off_ns": off}


def other(words: list[str]) -> dict[str, object]:
    """A writer of another type: of another name, or of the same name and another structure."""
    what, topic = words
    members = {"x_": t.float64, "y_": t.float64}
    names = {"name": "std_msgs.msg.dds_.Other_", "structure": "nav_msgs.msg.dds_.Odometry_"}
    kind: Any = make_idl_struct(names[what].split(".")[-1], names[what], members)
    own = DomainParticipant(int(os.environ["ROS_DOMAIN_ID"]))
    w: DataWriter[Any] = DataWriter(own, Topic(own, topic, kind), qos=RELIABLE)
    for i in range(150):
        w.write(kind(x_=float(i), y_=1.0))
        time.sleep(0.01)
    return {"sent": 150, "matched": len(w.get_matched_subscriptions())}


def numbers(words: list[str]) -> dict[str, object]:
    """Odometry whose numbers are NaN, infinities and the like: FILE has them, a sample a line."""
    topic, listed, file = words
    given = json.loads(Path(file).read_text(encoding="utf-8"))
    kinds: dict[str, type] = {}
    kind = type_of(TYPES["odom"], given, kinds)
    found = fields(TYPES["odom"], given)
    own = DomainParticipant(int(os.environ["ROS_DOMAIN_ID"]))
    w: DataWriter[Any] = DataWriter(own, Topic(own, topic, kind), qos=RELIABLE)
    end = time.monotonic() + 10.0
    while not w.get_matched_subscriptions() and time.monotonic() < end:
        time.sleep(0.02)
    time.sleep(1.0)
    for line in Path(listed).read_text(encoding="utf-8").splitlines():
        m = made_of("odom", 1, found, kinds, given)
        stamp(m)
        m.child_frame_id_ = "body"
        m.pose_.pose_.position_.x_, m.pose_.pose_.position_.y_ = (
            float.fromhex(x) for x in line.split()
        )
        w.write(m)
        print("sent", flush=True)
        sys.stdin.readline()
    return {}


if __name__ == "__main__":
    ways = {"other": other, "numbers": numbers}
    told = ways[sys.argv[1]](sys.argv[2:]) if sys.argv[1] in ways else exchange(sys.argv[1:])
    print(json.dumps(told), flush=True)
