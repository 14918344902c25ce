"""`soter run` after `soter verify`: "proved" of exactly what was proved, and of nothing else."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from soter.api import load
from soter.language.model.proof_verdicts import Proof
from soter.native import cache
from soter.simulate.result_assumptions import code_assumptions
from soter.verify import proof_cache

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from typing import Any

    Soter = Callable[..., Any]

CART = Path(__file__).resolve().parents[3] / "examples" / "wall" / "cart.soter"
SMALL = (
    ("/ 400", "/ 100"),
    ("/ 320", "/ 80"),
    ("tau * tau) + 0.12", "tau * tau) + 0.8"),
    ("soter 1;", "soter 1;\nparam GAIN: float = 1.0 in [0.5, 2.0];"),
    ("publish accel = clamp(4.0 *", "publish accel = clamp(GAIN * 4.0 *"),
)
MORE = """
system Twin { c: Cart; module SafeCart; until 30s; always Clear(c.truth); }
system Faulty {
  c: Cart; module SafeCart; until 30s; always Clear(c.truth);
  faults { silent c.motion at 6 per 1h for 30ms; }
}
"""
ASSUMED = "SafeCart: P1c P2a P2b P3 assumed, not checked"
PROVED = "SafeCart: P1c P2a P2b P3 proved under 16 assumptions (by `soter verify`, of exactly this)"


@pytest.fixture(scope="module")
def proofs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cache folder in which the proof of the small cart stands, and whatever was compiled."""
    folder = tmp_path_factory.mktemp("proofs")
    text = CART.read_text() + MORE
    for old, new in SMALL:
        assert old in text
        text = text.replace(old, new)
    (folder / "small.soter").write_text(text)
    users, find_cached = cache.cache_dir(), cache.find_cached

    def found(name: str, content: str, files: tuple[str, ...]) -> Path | None:
        entry = cache._entry_folder(users, name, content)
        if name == "objects" and entry.is_dir():  # of Soter's engines, not made anew
            shutil.copytree(entry, folder / "cache" / entry.name, dirs_exist_ok=True)
        return find_cached(name, content, files)

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SOTER_CACHE", str(folder / "cache"))
        patch.setattr(cache, "find_cached", found)
        report = load(folder / "small.soter").verify(refute=False)
        assert report.verdict == "proved"
    return folder


@pytest.fixture
def cart(proofs: Path, here: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The same program in the current folder, with the cache that knows its proof."""
    monkeypatch.setenv("SOTER_CACHE", str(here / "cache"))
    shutil.copytree(proofs / "cache", here / "cache")
    shutil.copy(proofs / "small.soter", here / "other-name.soter")
    return here / "other-name.soter"


def said(soter: Soter, *arguments: str) -> str:
    done = soter("run", "other-name.soter", "--until", "1s", *arguments)
    text: str = done.out
    return text


def test_a_run_says_proved_of_exactly_what_was_proved(soter: Soter, cart: Path) -> None:
    assert PROVED in said(soter)
    document = soter("run", cart.name, "--until", "1s", "--json").document
    proof = document["proofs"]["SafeCart"]
    assert proof["properties"]["P2a"] == "proved"
    assert proof["properties"]["failsafe"] == "assumed"
    assert len(proof["assumptions"]) == 16
    assert PROVED in said(soter, "--engine", "interp"), "the engines are compared bit for bit"


@pytest.mark.parametrize(
    ("code", "named"),
    [
        ("extern plant Truck period 1s { drives far = x; state x: float; }", "t"),
        ("extern fun far_off(x: float): float;", "far_off"),
        ("", None),
    ],
)
def test_code_that_is_in_no_proof_is_named_beside_it(
    tmp_path: Path, code: str, named: str | None
) -> None:
    text = CART.read_text() + "topic far: float;\n" + code
    if "plant" in code:
        text = text.replace("system Protected default {", "system Protected default { t: Truck; ")
    path = tmp_path / "cart.soter"
    path.write_text(text)
    system = load(path).declared("Protected")
    proofs = {"SafeCart": Proof({"P3": "proved"}, ())}
    (line,) = [x for x in code_assumptions(system, proofs) if "P3" in x]
    assert (f"the code of {named} (extern) is in no proof" in line) == (named is not None)
    assert ("extern" in line) == (named is not None)


def test_nothing_is_proved_where_nothing_was_verified(
    soter: Soter, cart: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SOTER_CACHE", str(cart.parent / "another"))
    assert ASSUMED in said(soter)


def test_a_cache_that_knows_no_proof_of_it_is_not_listed(
    soter: Soter, cart: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    listed: list[Path] = []

    def glob(folder: Path, pattern: str) -> Iterator[Path]:
        listed.append(folder)
        return paths(folder, pattern)

    paths = Path.glob
    monkeypatch.setattr(Path, "glob", glob)
    assert PROVED in said(soter)
    assert cache.cache_dir() in listed
    listed.clear()
    cart.write_text(cart.read_text() + " ")
    assert ASSUMED in said(soter)
    assert cache.cache_dir() not in listed


def test_a_program_with_one_more_blank_is_another_one(soter: Soter, cart: Path) -> None:
    cart.write_text(cart.read_text() + " ")
    assert ASSUMED in said(soter)


def test_another_value_of_a_parameter_is_another_program(soter: Soter, cart: Path) -> None:
    assert cart.exists()
    assert ASSUMED in said(soter, "--set", "GAIN=1.5")
    assert PROVED in said(soter, "--set", "GAIN=1.0"), "the value that it had"


def test_another_system_is_not_proved(soter: Soter, cart: Path) -> None:
    assert cart.exists()
    assert "proved" not in said(soter, "--system", "Twin")
    assert "SafeCart: P1c P2a P2b P3 assumed" in said(soter, "--system", "Twin")


def test_the_rules_of_an_arm_are_not_those_that_were_proved(soter: Soter, cart: Path) -> None:
    assert cart.exists()
    assert "proved" not in said(soter, "--arm", "ac")


def test_proofs_are_not_about_runs_in_which_something_goes_wrong(soter: Soter, cart: Path) -> None:
    run = load(cart).simulate(until=1.0)
    assert run.proofs
    assert cart.exists()
    assert "proved" not in said(soter, "--system", "Faulty")


def test_a_proof_of_another_soter_does_not_count(
    soter: Soter, cart: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert cart.exists()
    monkeypatch.setattr(proof_cache, "soter_sha256", lambda: "0" * 64)
    assert ASSUMED in said(soter)


def test_a_damaged_proof_does_not_count(soter: Soter, cart: Path) -> None:
    (entry,) = cache.cache_dir().glob("proof-*")
    text = (entry / "proof.json").read_text()
    (entry / "proof.json").write_text(text.replace("undecided", "proved") + " ")
    assert cart.exists()
    assert ASSUMED in said(soter)


def test_verdicts_that_differ_do_not_count(soter: Soter, cart: Path) -> None:
    (entry,) = cache.cache_dir().glob("proof-*")
    name, content = entry.name.split("-")[:2], proof_cache._content_hash(flat(cart), "SafeCart")
    with cache.new_entry(f"{name[0]}-{name[1]}-00000000", content, ("proof.json",)) as made:
        text = '{"verdicts": {"P2a": "undecided"}, "assumptions": []}'
        (made / "proof.json").write_text(text)
    assert ASSUMED in said(soter)


@pytest.mark.long
def test_what_is_not_decided_is_told(soter: Soter, cart: Path) -> None:
    text = cart.read_text()
    changed = text.replace("ttf Room(motion, 0.12)", "ttf Room(motion, 0.01)")
    assert changed != text
    cart.write_text(changed)
    report = load(cart).verify(refute=False)
    assert report.verdict == "undecided"
    out = said(soter)
    assert "undecided: not a proof of safety" in out
    assert "P2a" in out.split("proved under")[0].split("rests on")[1]


def flat(path: Path) -> Any:
    return load(path).flat()
