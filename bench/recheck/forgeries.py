"""Ways to forge a certificate, of five families of proofs.

Purpose: programs whose proofs take seconds, their certificates in memory, and forgeries of these
that are sealed as right ones are; what `soter verify` proves of a program, for whoever judges them.
Non-goals: checking, judging, counting (`forged.py`).
"""

from __future__ import annotations

import contextlib
import json
import os
import random
import re
import tempfile
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from bench.recheck.forged_programs import DRIVEN, EDITS, FACTS, HIDDEN, OPEN, PROGRAMS
from bench.recheck.late_forgeries import LATE_KINDS, fits
from bench.recheck.sealing import fit, read, seal

import soter
from soter.certificate.induction.induction_problem import read_induction
from soter.certificate.reading.module_facts import DiffersError
from soter.certificate.reading.problem import read_facts
from soter.certificate.report import NotRecheckedError, RejectedError
from soter.diagnostics.diagnostic import SoterError
from soter.language.front_end import check_file, system_to_prove

if TYPE_CHECKING:
    from collections.abc import Callable

MAIN = "small.soter"
Claim: TypeAlias = "tuple[str, str, tuple[tuple[str, str], ...]]"
"""System, module, and the values of all parameters as the report has them."""
Dice: TypeAlias = random.Random
DRAWN = "\x1b[1A\x1b[2KACCEPTED\r\u202e"


# ---------------------------------------------------------------- certificates


@dataclass(eq=False)
class Base:
    """A certificate that `soter verify` wrote, in memory."""

    name: str
    family: str
    text: str
    manifest: dict[str, Any]
    contents: dict[str, bytes]
    proved: bool
    variants: dict[str, Base] = field(default_factory=dict)
    """Of the same program, a little changed."""

    def write(self, folder: Path) -> None:
        """As it is."""
        Forged(self, folder).seal()


@dataclass(eq=False)
class Forged:
    """A forgery on its way: `text` is the program that it holds."""

    base: Base
    folder: Path
    name: str = ""
    manifest: dict[str, Any] = field(init=False)
    contents: dict[str, bytes] = field(init=False)
    text: str = field(init=False)

    def __post_init__(self) -> None:
        self.manifest = json.loads(json.dumps(self.base.manifest))
        self.contents = dict(self.base.contents)
        self.text = self.base.text

    def entry(self, dice: Dice) -> dict[str, Any]:
        """One of its modules."""
        entry: dict[str, Any] = dice.choice(self.manifest["modules"])
        return entry

    def seal(self) -> None:
        """Every file written, every hash right."""
        seal(self.folder, self.manifest, self.contents)


def certificate_of(name: str, family: str, text: str) -> Base | None:
    """What `soter verify` writes; None where there is nothing to be verified."""
    with tempfile.TemporaryDirectory() as at:
        path = Path(at) / MAIN
        path.write_text(text)
        try:
            report = soter.load(path).verify(cert=Path(at) / "cert", refute=False)
        except SoterError:
            return None
        manifest, contents = read(Path(at) / "cert")
    return Base(name, family, text, manifest, contents, report.verdict == "proved")


def base_of(name: str) -> Base:
    """A program's certificate with those of some variants."""
    family, text = PROGRAMS[name]
    base = certificate_of(name, family, text)
    assert base is not None, name
    assert base.proved or name in OPEN, name
    for what, changed in edited(text, EDITS)[:3]:
        variant = certificate_of(name, family, changed)
        if variant is not None:
            base.variants[what] = variant
    return base


def edited(text: str, edits: tuple[tuple[str, str, str], ...]) -> list[tuple[str, str]]:
    """The edits that change a text, with what they make of it."""
    variants = []
    for name, old, new in edits:
        changed, count = re.subn(old, new, text, flags=re.DOTALL)
        if count and name in DRIVEN:
            state = "x" if "state x" in text else "p"
            changed = re.sub(DRIVEN[name][0], DRIVEN[name][1].replace("STATE", state), changed)
        if count and changed != text:
            variants.append((name, changed))
    return variants


@lru_cache(maxsize=4096)
def proved_of(text: str, claim: Claim) -> frozenset[str]:
    """The properties that `soter verify` proves of just that system, module and these values."""
    system, module, values = claim
    with tempfile.TemporaryDirectory() as at:
        path = Path(at) / MAIN
        path.write_text(text)
        params = {n: float(v) for n, v in values}
        try:
            report = soter.load(path).verify(module, system=system, params=params, refute=False)
        except SoterError:
            return frozenset()
    return frozenset(
        n for m in report.modules for n, f in m.findings.items() if f.verdict == "proved"
    )


def finer(text: str) -> str:
    """The same program on cells a quarter as long."""
    return re.sub(r"(\] / )(\d+)", lambda m: f"{m[1]}{4 * int(m[2])}", text)


# ---------------------------------------------------------------- ways

TABLES: dict[str, Callable[[bytes, Dice], bytes]] = {
    "ones": lambda d, _: b"\x01" * len(d),
    "all": lambda d, _: b"\xff" * len(d),
    "more": lambda d, _: bytes(b or 3 for b in d),
    "shifted": lambda d, _: d[1:] + d[:1],
    "reversed": lambda d, _: d[::-1],
    "up": lambda d, _: bytes(min(b + 1, 255) if b else 0 for b in d),
    "half": lambda d, _: bytes(b // 2 for b in d),
    "flipped": lambda d, r: bytes(b ^ (1 << r.randrange(8)) if r.random() < 0.05 else b for b in d),
    "short": lambda d, _: d[: len(d) // 2],
}


def _sets(made: Forged, dice: Dice) -> None:
    names = [n for n in made.contents if n.startswith("sets/")]
    if not names:
        how = dice.choice(["k", "returns"])
        value = dice.choice([0, 1, 2, 3])
        made.name = f"{how} {value}"
        made.entry(dice)["induction"][how] = value
        return
    for _ in range(dice.choice([1, 1, 3])):
        name, how = dice.choice(names), dice.choice(list(TABLES))
        made.name += f"{name} {how} "
        made.contents[name] = TABLES[how](made.contents[name], dice)


def _claims(made: Forged, dice: Dice) -> None:
    for entry in made.manifest["modules"]:
        claims = entry["claims"]
        how = dice.choice(["all", "failsafe", "one less", "unknown", "P1c"])
        made.name += how + " "
        if how == "all":
            claims.update(dict.fromkeys(claims, "proved"))
        elif how == "one less":
            claims[dice.choice(list(claims))] = dice.choice(["undecided", "refuted", "assumed"])
        else:
            claims["P9" if how == "unknown" else how] = "proved"
        if dice.random() < 0.3:
            entry["recover_ns"] = dice.choice([None, 1, 10**9])


def _times(made: Forged, dice: Dice) -> None:
    entry = made.entry(dice)
    times = entry["times"] if "times" in entry else entry["induction"]["clocks"]
    key = dice.choice(list(times))
    by = dice.choice([-(10**7), -(10**6), -1, 1, 10**6, 10**7, 10**9])
    made.name = f"{key} {by:+d}"
    if isinstance(times[key], list):
        times[key][dice.randrange(len(times[key]))] += by
    else:
        times[key] += by


def _inputs(made: Forged, dice: Dice) -> None:
    entry = made.entry(dice)
    if "inputs" not in entry:
        key = dice.choice(["lemmas", "progress", "latching", "hyperperiod_ns"])
        made.name = key
        entry["induction"][key] = dice.choice([[], ["true"], True, 10**7])
        return
    item = dice.choice(entry["inputs"])
    side, factor = dice.choice(["low", "high"]), dice.choice([0.0, 0.5, 0.99, 1.01, 2.0])
    made.name = f"{item['name']} {side} * {factor}"
    item[side] = (float.fromhex(item[side]) * factor).hex()


def _sets_of_another(made: Forged, dice: Dice) -> None:
    """The sets that were shown for another program."""
    name, other = dice.choice([*made.base.variants.items()] or [("its own", made.base)])
    made.name = name
    own = {n: d for n, d in made.contents.items() if n.startswith("program/")}
    made.contents = own | {n: d for n, d in other.contents.items() if n.startswith("sets/")}
    kept = made.manifest["modules"]
    made.manifest["modules"] = json.loads(json.dumps(other.manifest["modules"]))
    if dice.random() < 0.7:
        for entry, mine in zip(made.manifest["modules"], kept, strict=False):
            for key in ("times", "inputs", "parameters"):
                if key in mine:
                    entry[key] = mine[key]
            entry["claims"] = mine["claims"]


def _program_of_another(made: Forged, dice: Dice, of: Any = EDITS) -> None:  # noqa: ANN401
    """The program of another certificate, and a manifest that fits it."""
    name, text = dice.choice(edited(made.base.text, of) or [("its own", made.base.text)])
    made.name, made.text = name, text
    made.contents[f"program/{MAIN}"] = text.encode()
    with tempfile.TemporaryDirectory() as at:
        (Path(at) / MAIN).write_text(text)
        checked = check_file(str(Path(at) / MAIN))
        if not checked.ok or checked.program is None:
            return
        made.manifest["program_sha256"] = checked.program.sha256
        for entry in made.manifest["modules"]:
            with contextlib.suppress(
                SoterError, DiffersError, NotRecheckedError, RejectedError, KeyError
            ):
                _adapted(entry, system_to_prove(checked, entry["system"], {}, exact=False))


def _adapted(entry: dict[str, Any], flat: Any) -> None:  # noqa: ANN401 - a system
    if "induction" in entry:
        induction = read_induction(flat, entry["module"])
        clocks = {c.name: [c.period_ns, c.phase_ns, 0, 0] for c in induction.actors}
        entry["induction"].update(clocks=clocks, hyperperiod_ns=induction.hyperperiod)
        lemmas = [" ".join(e.span.text.split()) for e in induction.symbol.verify.lemmas]
        entry["induction"]["lemmas"] = lemmas
        return
    facts = read_facts(flat, entry["module"])
    fit(entry, facts)
    if facts.symbol.verify.stays is not None or facts.symbol.verify.recover is None:
        entry["recover_ns"] = None


def _system_of_another(made: Forged, dice: Dice) -> None:
    entry = made.entry(dice)
    how = dice.choice(["system", "module", "twice", "plants", "other way round"])
    systems = re.findall(r"system (\w+)", made.text)
    modules = re.findall(r"rta (\w+)", made.text)
    if how == "system":
        entry["system"] = dice.choice([*systems, "Nowhere"])
    elif how == "module":
        entry["module"] = dice.choice([*modules, "Nothing"])
    elif how == "plants":
        entry["plants"] = dice.choice([[], ["q"], ["b"], ["a", "b"]])
    elif how == "twice":
        made.manifest["modules"].append(entry)
    else:
        names = [e["module"] for e in made.manifest["modules"]][::-1]
        for one, name in zip(made.manifest["modules"], names, strict=True):
            one["module"] = name
    made.name = f"{how} {entry.get('system')} {entry.get('module')}"


def _parameters(made: Forged, dice: Dice) -> None:
    value = dice.choice([0.5, 0.9, 1.0, 1.9, 2.5, 4.0, 8.9, 100.0])
    names = re.findall(r"param (\w+)", made.text) or ["GAIN"]
    params: Any = {names[0]: dice.choice([value.hex(), value.hex(), value, str(value)])}
    made.manifest["params"] = dice.choice([params, params, params, {}, [], {"M.GAIN": value.hex()}])
    made.name = json.dumps(made.manifest["params"])
    if dice.random() < 0.5 and "system T" in made.text:
        made.entry(dice)["system"] = "T"
        made.name += " in T"


def _work(made: Forged, dice: Dice) -> None:
    """As much work as a manifest can ask for."""
    entry = made.entry(dice)
    if "induction" in entry:
        key = dice.choice(["k", "returns"])
        entry["induction"][key] = dice.choice([5, 16, 64, 10**9])
        made.name = f"{key} {entry['induction'][key]}"
        return
    group = dice.choice(dice.choice(entry["cases"])["groups"])
    if dice.random() < 0.2:
        key = dice.choice(["H_ns", "A_ns", "d_ns", "j_ns", "h0_ns", "A_sc_ns"])
        entry["times"][key] = dice.choice([10**9, 60 * 10**9, 3600 * 10**9, 10**15])
        made.name = f"{key} {entry['times'][key]}"
    else:
        key = dice.choice([k for k in ("K", "Q", "W", "W_N") if k in group])
        name = group[key]
        data = made.contents[name]
        made.contents[name] = bytes(255 if b or dice.random() < 0.5 else 0 for b in data)
        made.name = f"{key} 255"


def _sizes(made: Forged, dice: Dice) -> None:
    """What lies in the folder; done when it is sealed."""
    how = dice.choice(["sparse", "sparse all", "empty", "pipe", "link", "folder", "device", "more"])
    names = [n for n in made.contents if n != f"program/{MAIN}" or dice.random() < 0.3]
    name = dice.choice([*names, "manifest.json", "SEAL", "sets/more.bin"])
    made.name = f"{how} {name}"
    made.seal()
    path = made.folder / name
    path.parent.mkdir(exist_ok=True)
    if how in ("pipe", "link", "folder", "device"):
        path.unlink(missing_ok=True)
    if how == "pipe":
        os.mkfifo(path)
    elif how == "folder":
        path.mkdir()
    elif how in ("link", "device"):
        path.symlink_to("/dev/zero" if how == "device" else made.folder.parent)
    elif how == "more":
        for k in range(8):
            _sparse(made.folder / f"sets{k}.bin", 300 << 20)
    else:
        _sparse(path, {"sparse": 20 << 30, "sparse all": 390 << 20}.get(how, 0))


def _sparse(path: Path, size: int) -> None:
    with path.open("wb") as file:
        file.truncate(size)


WRONG: tuple[Any, ...] = (None, True, -1, 1 << 70, 0.5, "", DRAWN, [], {}, [[]], {"a": 1}, "1e999")


def _names(made: Forged, dice: Dice) -> None:
    """Texts that draw, names of files, and leaves of a manifest that are something else."""
    how = dice.choice(["leaf", "leaf", "leaf", "key", "file", "main", "program"])
    made.name = how
    if how == "program":
        made.contents["program/other.soter"] = b"soter 1;\n"
    elif how == "file":
        made.contents[f"{dice.choice(['sets', 'program'])}/{DRAWN}.bin"] = b"\0"
    elif how == "main":
        old = made.contents.pop(f"program/{MAIN}")
        made.contents[f"program/{DRAWN}{MAIN}"] = old
        made.manifest["main"] = DRAWN + MAIN
    else:
        at: Any = made.manifest
        for _ in range(dice.randrange(1, 7)):
            keys = list(at) if isinstance(at, dict) else list(range(len(at)))
            key = dice.choice([k for k in keys if k != "files"])
            if not isinstance(at[key], (dict, list)) or not at[key]:
                break
            holder, at = at, at[key]
        else:
            at = holder  # the last container itself is replaced
        made.name += f" {key}"
        if how == "key" and isinstance(at, dict):
            at[DRAWN] = at.pop(key)
        else:
            at[key] = dice.choice(WRONG)


def _facts(made: Forged, dice: Dice) -> None:
    _program_of_another(made, dice, FACTS)


def _overlooked(made: Forged, dice: Dice) -> None:
    _program_of_another(made, dice, HIDDEN)
    for entry in made.manifest["modules"]:
        entry["claims"].update({n: "proved" for n in entry["claims"] if n != "P1c"})


KINDS: dict[str, Callable[[Forged, Dice], None]] = {
    "sets": _sets,
    "claims": _claims,
    "times": _times,
    "inputs": _inputs,
    "sets of another": _sets_of_another,
    "program of another": _program_of_another,
    "system of another": _system_of_another,
    "parameters": _parameters,
    "work": _work,
    "sizes": _sizes,
    "names and types": _names,
    "overlooked": _overlooked,
    "facts": _facts,
    **LATE_KINDS,
}


def forge(bases: dict[str, Base], family: str, kind: str, seed: int, folder: Path) -> Forged:
    """A forgery of that kind, written to the folder; the same for the same seed."""
    dice = random.Random(str(seed))  # noqa: S311 - no secret; neighbours share nothing
    base = dice.choice([b for b in bases.values() if b.family == family and fits(kind, b)])
    folder.mkdir()
    made = Forged(base, folder)
    KINDS[kind](made, dice)
    made.name = f"{base.name}: {made.name.strip()}"
    if kind != "sizes":
        made.seal()
    return made
