"""Four more ways to forge a certificate: what verdicts, shields, extremes and nodes add.

Purpose: kinds of forgeries of what came after the first twelve (`forgeries.py`), which bases each
of them needs, and commands of a forged shield that lead out of K by a calculation of its own.
Non-goals: sealing, checking, judging what is claimed (`forged.py`).
"""

from __future__ import annotations

import json
import struct
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.certificate.proof_methods import parts_without_claim

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from bench.recheck.forgeries import Base, Dice, Forged

HEXES = ("nan", "inf", "-inf", "-0x0.0p+0", "0x0.0p+0", "0x0.0000000000001p-1022", "0x1p-1074",
         "-0x0.0000000000001p-1022", "0x1.fffffffffffffp+1023", "0x1.0000000000000p+1024", "1.0",
         "0X1.0000000000000P+0", " 0x1.0000000000000p+0", "0x1.00000000000000p+0")  # fmt: skip
WHOLES = (1 << 63, (1 << 63) - 1, -(1 << 63), 1 << 64, (1 << 32) + 1, -1, 0, -0.0, 1e308, True)
DOUBLES = (float("nan"), float("inf"), float("-inf"), -0.0, 5e-324, -5e-324, 1.7e308, -1.7e308)
SHIELD_CELLS = 4
"""Of a command, in the programs with a shield."""


def shields(made: Forged, dice: Dice) -> None:
    """A table that permits nothing, everything, a little more, or is of something else."""
    entry = made.entry(dice)
    table = entry["tables"][0]
    data = made.contents[table["commands"]]
    low = [k % SHIELD_CELLS for k in range(len(data))]
    made.name = how = dice.choice(
        ["nothing", "everything", "wider", "wider once", "more", "less", "reversed", "shifted",
         "command", "levels", "a third", "cells"]
    )  # fmt: skip
    wider = bytes(min(b + 1, SHIELD_CELLS) if b else 0 for b in data)
    at = dice.randrange(len(data))
    changed = {
        "nothing": bytes(len(data)),
        "everything": bytes([SHIELD_CELLS]) * len(data),
        "wider": wider,
        "wider once": data[:at] + wider[at : at + 1] + data[at + 1 :],
        "more": bytes(b or k + 1 for b, k in zip(data, low, strict=True)),
        "less": bytes(b - 1 if b > k + 1 else b for b, k in zip(data, low, strict=True)),
        "reversed": data[::-1],
        "shifted": data[SHIELD_CELLS:] + data[:SHIELD_CELLS],
        "a third": bytes(0 if dice.random() < 0.33 else b for b in data),
        "cells": bytes(5 if dice.random() < 0.02 else b for b in data),
    }
    if how == "command":
        table["command"] = dice.choice([1, -1, None, True, 0.0, "u", [0], 1 << 63])
        made.name += f" {table['command']}"
    elif how == "levels":
        levels = made.contents[table["levels"]]
        made.contents[table["levels"]] = dice.choice([levels[::-1], b"\xff" * len(levels)])
        made.contents[entry["cases"][0]["groups"][0]["S"][0]] = b"\xff" * (
            len(data) // 8 // SHIELD_CELLS
        )
    else:
        made.contents[table["commands"]] = changed[how]


def surely_out(made: Forged) -> str:
    """A command cell that a shield permits and that leaves K within H from where it looks, or "".

    By arithmetic of its own, for `der p = u + w` alone: the estimate is right and new, w constant.
    """
    entry = made.manifest["modules"][0]
    group, table = entry["cases"][0]["groups"][0], entry["tables"][0]
    edges = np.frombuffer(made.contents[group["axes"][0]["edges"]])
    core = np.frombuffer(made.contents[group["K"]], dtype=np.uint8) > 0
    beyond = ~np.unpackbits(
        np.frombuffer(made.contents[group["S"][0]], dtype=np.uint8), bitorder="little"
    )[: len(core)].astype(bool)
    tops = np.frombuffer(made.contents[table["commands"]], dtype=np.uint8)
    tops = tops.reshape(len(core), SHIELD_CELLS)
    by_name = {i["name"].split(".")[-1]: i for i in entry["inputs"]}
    (low, high), wind = (
        [float.fromhex(by_name[n][side]) for side in ("low", "high")] for n in ("u", "w")
    )
    for cell in np.flatnonzero(beyond):
        for i in np.flatnonzero(tops[cell]):
            ends = [low + (high - low) * k / SHIELD_CELLS for k in (i, int(tops[cell, i]))]
            for command, gust, at in ((c, g, s) for c in ends for g in wind for s in (0.01, 0.99)):
                start = edges[cell] * (1 - at) + edges[cell + 1] * at
                way = start + (command + gust) * np.linspace(0, entry["times"]["H_ns"] / 1e9, 50)
                where = np.searchsorted(edges, way) - 1
                inside = (where >= 0) & (where < len(core))
                if not (inside.all() and core[where].all()):
                    return f"from {start:g} the command {command:g} leads out of K"
    return ""


# ---------------------------------------------------------------- numbers and parts


def _leaves(at: Any, wanted: type | tuple[type, ...]) -> Iterator[tuple[Any, Any]]:  # noqa: ANN401
    """Every (container, key) below at which a value of that type stands."""
    for key in at if isinstance(at, dict) else range(len(at)):
        if isinstance(at[key], (dict, list)):
            yield from _leaves(at[key], wanted)
        elif isinstance(at[key], wanted):
            yield at, key


def extremes(made: Forged, dice: Dice) -> None:
    """One number is no number, infinite, minus zero, subnormal, or at the ends of 64 bits."""
    modules = made.manifest["modules"]
    texts = [
        (holder, key)
        for holder, key in _leaves(modules, str)
        if holder[key].startswith(("0x", "-0x"))
    ]
    whole = list(_leaves(modules, (int, float)))
    doubles = [n for n in made.contents if any(x in n for x in ("axis", "_m", "box", "faces"))]
    if texts and dice.random() < 0.4:
        holder, key = dice.choice(texts)
        holder[key] = dice.choice(HEXES)
        made.name = f"{key} {holder[key]}"
    elif doubles and dice.random() < 0.5:
        name = dice.choice(doubles)
        data = bytearray(made.contents[name])
        at, value = dice.randrange(len(data) // 8), dice.choice(DOUBLES)
        data[8 * at : 8 * at + 8] = struct.pack("<d", value)
        made.contents[name] = bytes(data)
        made.name = f"{name}[{at}] {value}"
    else:
        holder, key = dice.choice(whole)
        own = holder[key]
        holder[key] = dice.choice([*WHOLES, own + (1 << 63), own + (1 << 32), float(own), -own])
        made.name = f"{key} {holder[key]}"


def exchanged(made: Forged, dice: Dice) -> None:
    """Parts in each other's place: sets of a group, of two modules, of two claims; lemmas."""
    entry = made.entry(dice)
    if "induction" in entry:
        _exchanged_of_induction(made, entry["induction"], dice)
        return
    groups = [g for e in made.manifest["modules"] for c in e["cases"] for g in c["groups"]]
    group, other = dice.choice(groups), dice.choice(groups)
    mine, theirs = (dice.choice([n for n in "KRQW" if n in g]) for g in (group, other))
    made.name = f"{mine} and {theirs}"
    if dice.random() < 0.3:
        names = [n for n in made.contents if n.startswith("sets/")]
        one, two = dice.choice(names), dice.choice(names)
        made.contents[one], made.contents[two] = made.contents[two], made.contents[one]
        made.name = f"{one} and {two}"
    elif dice.random() < 0.3:
        other[theirs] = group[mine]
        made.name += ", both the first"
    else:
        group[mine], other[theirs] = other[theirs], group[mine]


def _exchanged_of_induction(made: Forged, entry: dict[str, Any], dice: Dice) -> None:
    made.name = how = dice.choice(["clocks", "lemmas twice", "no lemma", "a lemma more", "end"])
    clocks, lemmas = entry["clocks"], entry["lemmas"]
    if how == "clocks":
        one, two = dice.choice(list(clocks)), dice.choice(list(clocks))
        clocks[one], clocks[two] = clocks[two], clocks[one]
        made.name += f" {one} {two}"
    elif how == "lemmas twice":
        entry["lemmas"] = lemmas[::-1] + lemmas[:1]
    elif how == "no lemma":
        entry["lemmas"] = lemmas[1:]
    elif how == "a lemma more":
        lemmas.append(
            dice.choice(["false", "good(candidate)", "good(flown)", "age(candidate) < 0.0"])
        )
    else:
        key = dice.choice(["latching", "k", "returns", "hyperperiod_ns"])
        entry[key] = dice.choice([0, 1, 2, 3, True, False, None, [], 1.0])
        made.name += f" {key} {entry[key]}"


# ---------------------------------------------------------------- verdicts


def verdicts(made: Forged, dice: Dice) -> None:
    """Claims dropped or added, with and without what they rest on; tables and modules left out."""
    entry = made.entry(dice)
    claims = entry["claims"]
    made.name = how = dice.choice(
        ["dropped", "dropped", "all dropped", "all claimed", "emptied", "no tables", "no groups",
         "module left out", "hidden", "a key of another method"]
    )  # fmt: skip
    if how == "dropped":
        name = dice.choice(list(claims))
        claims[name] = dice.choice(["assumed", "undecided", "refuted"])
        made.name += f" {name} {claims[name]}"
        if dice.random() < 0.3:
            del claims[name]
    elif how == "all dropped":
        claims.update(dict.fromkeys([n for n in claims if n not in ("P1a", "P1b")], "undecided"))
    elif how == "all claimed":
        claims.update(dict.fromkeys(claims, "proved"))
    elif how == "emptied":
        for group in (g for c in entry.get("cases", []) for g in c["groups"] if "K" in g):
            if isinstance(group["K"], str):
                made.contents[group["K"]] = bytes(len(made.contents[group["K"]]))
    elif how == "no tables":
        entry["tables"] = []
    elif how == "no groups":
        for case in entry.get("cases", []):
            case["groups"] = case["groups"][1:]
    elif how == "module left out":
        made.manifest["modules"].remove(entry)
    elif how == "hidden":
        entry[dice.choice(["view", "law", "not_rechecked", "tables"])] = dice.choice(["", [], None])
    else:
        other = {"induction": {"k": 1, "lemmas": [], "clocks": {}}, "cases": []}
        key = dice.choice([k for k in other if k not in entry] or ["cases"])
        entry[key] = other[key]
        made.name += f" {key}"
    if dice.random() < 0.8:
        _only_claimed(made)


def _only_claimed(made: Forged) -> None:
    """Take out what no claim rests on, as an honest writer does."""
    for entry in made.manifest["modules"]:
        claims = {n for n, verdict in entry["claims"].items() if verdict == "proved"}
        for group in (g for c in entry.get("cases", []) for g in c["groups"]):
            for name in parts_without_claim(group, claims, computed="tables" in entry):
                del group[name]
        if "P2b" not in claims and "recover_ns" in entry:
            entry["recover_ns"] = None
    named = json.dumps(made.manifest["modules"])
    made.contents = {
        n: d for n, d in made.contents.items() if n.startswith("program/") or f'"{n}"' in named
    }


LATE_KINDS: dict[str, Callable[[Forged, Dice], None]] = {
    "shields": shields,
    "extremes": extremes,
    "exchanged": exchanged,
    "verdicts": verdicts,
}


def fits(kind: str, base: Base) -> bool:
    """Whether a base has what a kind forges."""
    if kind == "shields":
        return "shield" in base.text
    return kind != "facts" or any(name in base.name for name in ("shielded", "taking"))
