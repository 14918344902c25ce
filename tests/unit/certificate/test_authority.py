"""What the re-checker does not understand it refuses; what it says it has derived itself."""

from __future__ import annotations

import json
from dataclasses import fields
from typing import TYPE_CHECKING, Any

import pytest

from json_documents import problems_of
from long_tests import some
from soter.api import recheck
from soter.certificate import rechecker
from soter.certificate.reading import supported_constructs as supported
from soter.cli.main import main
from soter.language.model import typed
from tables import all_rows
from unit.certificate import small_proofs

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    Change = Callable[[Callable[[dict[str, Any]], None]], Path]

SYSTEM = "system Track default { c: Cart; module SafeCart; until 10s; }"
CAREFUL = "node Careful period 50ms {\n  subscribes motion;\n  publishes accel;\n  step {"
NOT_UNDERSTOOD = {
    "a takeover that faults": (
        CAREFUL,
        CAREFUL.replace("  step {", "  on takeover { assert false; }\n  step {"),
        "takeover",
    ),
    "in_control": (CAREFUL, f"{CAREFUL} assert in_control;", "in_control"),
    "a queue that nobody reads": (
        CAREFUL,
        CAREFUL.replace("motion;", "motion, noise queue 1 fault;"),
        "queue",
    ),
    "a sensor that is too slow": ("plant Cart period 10ms", "plant Cart period 1s", "R011"),
    "AC is forced": (
        SYSTEM,
        SYSTEM.replace("until", "force SafeCart ac; until"),
        "forced",
    ),
    "a plant that chooses": (
        "drives motion = { x: x, v: v };",
        "drives motion = { x: choose { x, x + 0.5 }, v: v };",
        "`choose` in the plant `c`",
    ),
    "another plant that chooses": (
        SYSTEM,
        "topic door: bool;\nplant Door period 1s "
        "{ drives door = choose bool; state s: bool; next s = s; }\n"
        + SYSTEM.replace("until", "door: Door; until"),
        "`door` chooses",
    ),
    "mode": (CAREFUL, f"{CAREFUL} assert mode(SafeCart) == Mode.SC;", "mode"),
    "time": (CAREFUL, f"{CAREFUL} assert time < 5.0;", "time"),
    "age": (CAREFUL, f"{CAREFUL} assert age(motion) < 5.0;", "age"),
}


FALSE = ("a sensor that is too slow",)
"""The program says something else than the certificate."""


@pytest.mark.parametrize("name", NOT_UNDERSTOOD)
def test_what_is_not_on_the_list_is_not_rechecked(copied: Path, name: str) -> None:
    old, new, why = NOT_UNDERSTOOD[name]
    pairs = [(old, new)]
    if "noise" in new:
        pairs.append(("topic accel", "input topic noise: float in [0.0, 1.0];\ntopic accel"))
        pairs.append(("until 10s", "input noise every 10ms; until 10s"))
    small_proofs.edit_program(copied, *pairs)
    report = recheck(copied)
    assert report.verdict == ("rejected" if name in FALSE else "not re-checked"), report.reason
    assert why in report.reason


def test_a_construct_with_a_field_more_is_refused(
    copied: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    known = supported.CODE[typed.TypedBinary].replace(" op", "")
    monkeypatch.setitem(supported.CODE, typed.TypedBinary, known)
    report = recheck(copied)
    assert not report.accepted
    assert "`Binary` is not known here" in report.reason


def test_a_construct_that_is_new_is_refused(copied: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(supported.CODE, typed.TypedPublish)
    report = recheck(copied)
    assert "`publish` in SC is not rechecked yet" in report.reason


def test_the_list_is_that_of_the_language() -> None:
    """A field that was added to the language: judge what it does to a proof, then name it here."""
    for of, names in {**supported.CODE, **supported.DECLARATIONS, **supported.ELABORATED}.items():
        assert {f.name for f in fields(of)} == set(names.split()), of.__name__


# ---------------------------------------------------------------- what is derived


def test_an_entry_has_no_word_about_assumptions(changed: Change) -> None:
    def change(manifest: dict[str, Any]) -> None:
        manifest["modules"][0]["assumptions"] = ["none: holds for every robot"]

    report = recheck(changed(change))
    assert (report.verdict, report.reason) == (
        "rejected",
        "a module has an unknown `assumptions`",
    )


def test_of_assumptions_in_a_manifest_only_the_numbers_are_taken(
    proved: Path, changed: Change, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A forged list numbers otherwise, and drops, adds and changes nothing that is derived."""
    monkeypatch.setattr(rechecker, "_check_cases", lambda *_: None)  # claims are no matter of it
    plain = recheck(proved)
    derived = [[a.key, a.text] for a in plain.all_assumptions]
    numbers = [f"A{k}" for k in range(1, len(derived) + 1)]
    assert [plain.assumption_numbers[text] for text in plain.assumptions] == numbers
    forged: dict[str, list[list[str]]] = {
        "backwards": derived[::-1],
        "dropped": derived[:1],
        "added": [["none", "it holds for every robot"], *derived],
        "changed under its key": [[key, f"not {text}"] for key, text in derived],
        "under another key": [["none", text] for _, text in derived],
        "with its key in the place of the text": [[text, key] for key, text in derived],
        "said twice": derived * 2,
    }
    for how, said in forged.items():
        report = recheck(changed(lambda m, said=said: m.update(assumptions=said)))  # type: ignore[misc]
        assert report.accepted, (how, report.reason)
        assert report.all_assumptions == plain.all_assumptions, how
        assert len({report.assumption_numbers[text] for text in report.assumptions}) == len(
            derived
        ), how
        assert (report.assumption_numbers == plain.assumption_numbers) == (
            how in ("dropped", "under another key", "said twice")
        ), how


@all_rows("said", [None, {"ab": "c"}, "ab", ["ab"], [["a"]], [["a", 1]], [["a", ["b"]]]])
def test_a_list_of_assumptions_that_is_none_is_rejected(changed: Change, said: object) -> None:
    report = recheck(changed(lambda m: m.update(assumptions=said)))
    wrong = "`assumptions` is not as it should be"
    assert (report.verdict, report.reason) == ("rejected", wrong)


@pytest.mark.long
def test_assumptions_are_those_of_the_program(proved: Path) -> None:
    report = recheck(proved)
    assert report.accepted
    keys = {a.key for a in report.all_assumptions}
    assert {"scheme", "wait", "order", "no dropout", "undeclared acts within"} <= keys
    assert "disturbance c.wind in [-0.1, 0.1]" in keys


def test_p1c_is_not_proved_where_times_are_undeclared(changed: Change) -> None:
    folder = changed(lambda m: m["modules"][0]["claims"].update(P1c="proved"))
    report = recheck(folder)
    assert not report.accepted
    assert "not declared" in report.reason


SHORTER = ("A_ns", "A_sc_ns", "H_star_ns", "H_ns", "d_ns", "j_ns", "h0_ns")


@pytest.mark.parametrize("key", some(SHORTER, 2))
def test_a_time_that_is_shorter_than_there_is_is_rejected(changed: Change, key: str) -> None:
    own = recheck(changed(lambda _: None)).modules[0].times[key]
    folder = changed(lambda m: m["modules"][0]["times"].update({key: own - 1}))
    report = recheck(folder)
    assert not report.accepted
    assert f"{key} is {own - 1} in the manifest" in report.reason


@pytest.mark.long
def test_a_delay_that_is_longer_is_what_counts(changed: Change) -> None:
    own = recheck(changed(lambda _: None)).modules[0].times
    longer = {"A_ns": own["A_ns"] + 1, "d_ns": own["d_ns"] + 1}
    report = recheck(changed(lambda m: m["modules"][0]["times"].update(longer)))
    assert report.accepted, report.reason
    assert report.modules[0].times == own | longer
    longer["d_ns"] += 900_000_000
    report = recheck(changed(lambda m: m["modules"][0]["times"].update(longer)))
    assert report.accepted, report.reason  # on reads as old as they are, and it says so
    assert report.modules[0].times == own | {"A_ns": own["A_ns"] + 1}
    longer = {"j_ns": own["j_ns"] + 10_000_000}
    assert not recheck(changed(lambda m: m["modules"][0]["times"].update(longer))).accepted


# ---------------------------------------------------------------- what it is about

OTHERS = """system Other { c: Cart; module SafeCart; force SafeCart ac; until 1s; }
param GAIN: float = 2.0 in [0.0, 9.0];
"""


@pytest.mark.long
def test_the_verdict_says_what_it_is_about(
    copied: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    manifest = small_proofs.edit_program(
        copied, (SYSTEM, OTHERS + SYSTEM), ("-2.0 * motion.x", "-GAIN * motion.x")
    )
    manifest["params"] = {"GAIN": (2.0).hex()}
    small_proofs.seal(copied, manifest)
    report = recheck(copied)
    assert report.accepted, report.reason
    (module,) = report.modules
    assert (report.program, module.system, module.name) == ("cart.soter", "Track", "SafeCart")
    assert module.parameters == {"GAIN": "2.0"}
    keys = {s.key: s.text for s in report.not_covered}
    assert "forced to ac" in keys["module Other SafeCart"]
    assert "GAIN = 2.0" in keys["parameters"]
    assert {"compiled", "dropout SafeCart"} <= keys.keys()
    assert main(["recheck", str(copied)]) == 0
    out = capsys.readouterr().out
    assert "SafeCart of system Track in cart.soter" in out
    assert "with GAIN = 2.0" in out
    assert "module SafeCart of system Other (forced to ac)" in out
    assert main(["recheck", str(copied), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert not problems_of(document)
    assert document["modules"]["SafeCart"]["parameters"] == {"GAIN": "2.0"}
    assert [s["key"] for s in document["not_covered"]] == list(keys)


def test_a_module_twice_is_rejected(changed: Change) -> None:
    report = recheck(changed(lambda m: m.update(modules=2 * m["modules"])))
    assert "twice" in report.reason


def test_contracts_are_named_as_not_covered(copied: Path) -> None:
    contract = CAREFUL.replace("  step {", "  guarantees accel < 0.0;\n  step {")
    small_proofs.edit_program(copied, (CAREFUL, contract))
    report = recheck(copied)
    assert report.accepted, report.reason
    assert "contracts Careful" in {s.key for s in report.not_covered}
