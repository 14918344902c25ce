"""The theorem of docs/proof.md in Coq: it compiles, and assumes what Coq's library assumes."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

import processes

ROOT = Path(__file__).resolve().parents[2]
PROOFS = ROOT / "proofs"
PROJECT = (PROOFS / "_CoqProject").read_text(encoding="utf-8")
FILES = re.findall(r"^\w+\.v$", PROJECT, re.MULTILINE)
MAIN = ("Module.invariant", "Module.safe")
LIBRARY = {
    "ClassicalDedekindReals.sig_forall_dec",
    "ClassicalDedekindReals.sig_not_dec",
    "FunctionalExtensionality.functional_extensionality_dep",
    "Classical_Prop.classic",
}
"""What Coq's own library assumes: of reals, of functions, of classical logic."""
UNPROVED = re.compile(r"\b(Admitted|admit|Axioms?|Parameters?|Conjecture|Unset|bypass_check)\b")
MOST_LINES = 1000
WRONG = (
    ("Module.v", "Rmax (dm_late T + dm_response T) (G T + sc_late T)", "(G T + sc_late T)"),
    ("Module.v", "H_star := age T + Delta T", "H_star := Delta T"),
    ("Module.v", "state_age := sc_age T + sc_response T + L T", "state_age := sc_age T"),
    ("Module.v", "Rmax (sc_late T) (dm_late T + dm_response T - r T)", "sc_late T"),
    ("Module.v", "(q + dm_late T + dm_response T - rho)", "(- rho)"),
    ("Module.v", "Hypothesis P1c : H_star T <= H", "Hypothesis P1c : H_star T <= 2 * H"),
    ("Releases.v", "(a <= d - g + r)%Z", "(a <= d - g)%Z"),
)
"""File, what stands there, and what a wrong theorem would say in its place."""


def compiled(folder: Path, name: str) -> processes.Done:
    words = ["coqc", "-q", "-Q", ".", "Soter", name]
    return processes.run(words, cwd=folder, capture_output=True, text=True)


@pytest.fixture(scope="module")
def proofs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with everything compiled."""
    if shutil.which("coqc") is None:
        pytest.skip("no Coq here: the theorem is not checked by a machine")
    folder = tmp_path_factory.mktemp("proofs")
    for name in FILES:
        shutil.copy(PROOFS / name, folder / name)
        done = compiled(folder, name)
        assert done.returncode == 0, f"{name}: {done.stdout}{done.stderr}"
    return folder


def assumptions(folder: Path, theorem: str) -> set[str]:
    """The names that `Print Assumptions` prints of a theorem `File.name`."""
    module = theorem.partition(".")[0]
    (folder / "Ask.v").write_text(f"From Soter Require {module}.\nPrint Assumptions {theorem}.\n")
    done = compiled(folder, "Ask.v")
    assert done.returncode == 0, done.stderr
    said = str(done.stdout)
    if "Closed under the global context" in said:
        return set()
    assert said.startswith("Axioms:"), said
    return set(re.findall(r"^[^\s:]+", said.partition("\n")[2], re.MULTILINE))


def test_every_file_is_compiled_and_proves_what_it_says() -> None:
    there = sorted(p.name for p in PROOFS.glob("*.v"))
    assert there == sorted(FILES)
    texts = {name: (PROOFS / name).read_text(encoding="utf-8") for name in FILES}
    assert {n: UNPROVED.findall(t) for n, t in texts.items() if UNPROVED.search(t)} == {}
    assert sum(t.count("\n") for t in texts.values()) <= MOST_LINES


@pytest.mark.parametrize("theorem", MAIN)
def test_a_theorem_rests_on_axioms_of_the_library_only(proofs: Path, theorem: str) -> None:
    assert assumptions(proofs, theorem) <= LIBRARY


def test_an_axiom_of_ones_own_is_seen(proofs: Path) -> None:
    (proofs / "Wrong.v").write_text(
        "Axiom wrong : forall n : nat, n = 0.\nDefinition used := wrong.\n"
    )
    assert compiled(proofs, "Wrong.v").returncode == 0
    assert assumptions(proofs, "Wrong.used") == {"Wrong.wrong"}


@pytest.mark.parametrize(("name", "true", "false"), WRONG, ids=[w[1] for w in WRONG])
def test_a_wrong_theorem_is_not_proved(
    proofs: Path, tmp_path: Path, name: str, true: str, false: str
) -> None:
    shutil.copytree(proofs, tmp_path / "wrong")
    text = (proofs / name).read_text(encoding="utf-8")
    assert text.count(true) >= 1
    (tmp_path / "wrong" / name).write_text(text.replace(true, false), encoding="utf-8")
    done = compiled(tmp_path / "wrong", name)
    assert done.returncode != 0
    assert f'File "./{name}"' in done.stderr
    assert "Syntax error" not in done.stderr
