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
MAIN = (
    "Module.safe",
    "Module.invariant",
    "Gate.gate_safe",
    "Trajectories.gate_refuses_no_more",
    "Return.control_returns",
    "ScRuns.core_of_chains",
    "ScRuns.returns_collected",
    "Composition.all_promises_hold",
    "Releases.r_and_G",
    "Implicit.good_stays",
    "Implicit.box_rests",
    "Implicit.settles_collected",
    "Implicit.rules_rest",
    "Implicit.memory_kept",
    "Implicit.verdict_safe",
    "Implicit.verdict_rests",
    "Implicit.decided_returns",
    "Implicit.start_safe",
    "Implicit.implicit_safe",
    "Implicit.gated_safe",
    "Instance.flight_safe",
    "Instance.flight_gated",
    "Instance.flight_returns",
    "Instance.dm_goes_by_its_predicates",
    "Instance.gate_permits_more",
    "Instance.flight_decided",
    "Instance.flight_decided_returns",
    "Instance.flight_judged",
    "Instance.flight_remembers",
)
LIBRARY = {
    "ClassicalDedekindReals.sig_forall_dec",
    "ClassicalDedekindReals.sig_not_dec",
    "FunctionalExtensionality.functional_extensionality_dep",
    "Classical_Prop.classic",
}
"""What Coq's own library assumes: of reals, of functions, of classical logic."""
UNPROVED = re.compile(r"\b(Admitted|admit|Axioms?|Parameters?|Conjecture|Unset|bypass_check)\b")
MOST_LINES = 1740
WRONG = (
    ("Module.v", "Rmax (dm_late T + dm_response T) (G T + sc_late T)", "(G T + sc_late T)"),
    (
        "Module.v",
        "Rmax (dm_late T + dm_response T) (G T + sc_late T)",
        "(dm_late T + dm_response T)",
    ),
    ("Module.v", "H_star := age T + Delta T", "H_star := Delta T"),
    ("Module.v", "state_age := sc_age T + sc_response T + L T", "state_age := sc_age T"),
    ("Module.v", "Rmax (sc_late T) (dm_late T + dm_response T - r T)", "sc_late T"),
    ("Module.v", "Rmax (sc_late T) (q + dm_late T + dm_response T - rho)", "sc_late T"),
    ("Module.v", "Hypothesis start : look_ahead P K h0 (x 0)", "Hypothesis start : K (x 0)"),
    ("Module.v", "-> look_ahead P K H z.", "-> look_ahead P K (H / 2) z."),
    ("Module.v", "windows_apart : 2 * window <= delta T", "windows_apart : window <= 2 * delta T"),
    (
        "Gate.v",
        "e <= now /\\\n  forall e' a' v', emitted",
        "s - L T < e <= now /\\\n  forall e' a' v', emitted",
    ),
    ("Gate.v", "dm_start ex k <= e -> dm_release T k - age T <= s", "dm_start ex k <= e -> s <= e"),
    (
        "Gate.v",
        "now < e <= dm_out ex k -> ac_mode ex e",
        "now < e <= dm_start ex k -> ac_mode ex e",
    ),
    ("Gate.v", "(may_act s now) H (L T - L_min T) z", "(may_act s now) H 0 z"),
    ("Return.v", "complete ex m + T_Q + window T + age T", "complete ex m + T_Q + age T"),
    ("Implicit.v", "Rmax (Delta T - dm_late T + L_min T)", "Rmax (Delta T + L_min T)"),
    ("Implicit.v", "(H - delta T - window T)", "(H - delta T)"),
    ("Implicit.v", "Rmax 0 (h0 - delta T - window T)", "Rmax 0 (h0 - delta T)"),
    ("Implicit.v", "P1c : H_star T <= H", "P1c : H_star T - age T <= H"),
    (
        "Implicit.v",
        "fb_flow : flow P x u 0 b }",
        "fb_flow : flow P x u 0 b;\n  fb_held : forall t i, 0 <= t < al 0%nat -> u t i = u 0 i }",
    ),
    ("Implicit.v", "<= sc_seen m p <= sc_start ex m", "- sc_age T <= sc_seen m p <= sc_start ex m"),
    (
        "Implicit.v",
        "counts ex m /\\ forall p, dm_seen k <= sc_seen m p",
        "counts ex m /\\ forall p, dm_seen k - age T <= sc_seen m p",
    ),
    ("Implicit.v", "H_star T - age T - Delta T - L_min T", "L T - L_min T"),
    (
        "Implicit.v",
        "counts ex m /\\ forall p, s <= sc_seen m p",
        "counts ex m /\\ forall p, s - age T <= sc_seen m p",
    ),
    # of SC's topics one may have been read before the estimate
    ("Implicit.v", "forall p, dm_seen k <= sc_seen m p", "exists p, dm_seen k <= sc_seen m p"),
    ("Implicit.v", "delta j d shown).", "delta j d Q)."),
    ("Implicit.v", "forall z, M (x (al N)) z -> C z", "forall z, M (x (al N)) z -> shown z"),
    ("Implicit.v", "/\\ b < al N_T)", "/\\ b <= b)"),
    ("Implicit.v", "forall z, safe_with (map_of k) z", "forall z, safe_with (map_of 0%nat) z"),
    ("Implicit.v", "INR N * delta - j <= t - al 0%nat <=", "INR N * delta <= t - al 0%nat <="),
    ("Implicit.v", "(Y z \\/ reaches Y z)", "(Y z \\/ False)"),
    (
        "Implicit.v",
        "answered Y i (u t i)",
        (
            "exists z y o, (Y z \\/ reaches Y z) /\\ reads_as P z y /\\ answers y o /\\ "
            "o = u t /\\ o i = o i"
        ),
    ),
    ("Implicit.v", "V i s <= by_ i)", "V i s <= 2 * by_ i)"),
    ("Implicit.v", "l1 = l \\/ on_takeover (y m) (o m) l = Some l1 ->\n", "True ->\n"),
    ("Implicit.v", "s + h + INR N_T * delta T + window T <= b", "s + h + INR N_T * delta T <= b"),
    ("Implicit.v", "at_rest_by n + age T + Delta T + dm_late", "at_rest_by n + Delta T + dm_late"),
    ("ScRuns.v", "Hypothesis j_small : j < delta", "Hypothesis j_small : j < 2 * delta"),
    # a set on the way: met at no output, reached in no time, never left again
    ("Implicit.v", "-> B x (al N))) ->", "-> exists t, 0 <= t <= al N /\\ B x t)) ->"),
    ("Implicit.v", "settles C x al b (n1 + n2)", "settles C x al b (Nat.max n1 n2)"),
    (
        "ScRuns.v",
        "-> B (x (al 0%nat)) -> exists N, (1 <= N)%nat",
        "-> B (x (al 0%nat)) -> exists N, (0 <= N)%nat",
    ),
    ("Composition.v", "exists y, changed c y", "exists y, original c y"),
    ("Releases.v", "a <= d - g + r)", "a <= d - g)"),
    (
        "Instance.v",
        "shows := fun _ z y => -2 <= y - z <= 2",
        "shows := fun _ z y => -10 <= y - z <= 10",
    ),
    ("Instance.v", "0 <= a -> h <= 31", "0 <= a -> h <= 33"),
    ("Instance.v", "near a h 9 (ball m)", "near a h 8 (ball m)"),
    ("Instance.v", "ttf y := ~ ball 160 y", "ttf y := ~ ball 170 y"),
)
"""A file, what stands there, and what a wrong theorem would say in its place."""


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


def assumptions(folder: Path, theorems: tuple[str, ...]) -> set[str]:
    """The names that `Print Assumptions` prints of all these theorems `File.name` together."""
    files = {t.partition(".")[0] for t in theorems}
    questions = [
        f"From Soter Require {' '.join(sorted(files))}.",
        f"Definition all := ({', '.join(f'@{t}' for t in (*theorems, 'eq'))}).",
        "Print Assumptions all.",
    ]
    (folder / "Ask.v").write_text("\n".join(questions) + "\n")
    done = compiled(folder, "Ask.v")
    assert done.returncode == 0, done.stderr
    if done.stdout.startswith("Closed under the global context"):
        return set()
    assert done.stdout.startswith("Axioms:\n"), done.stdout
    return set(re.findall(r"^[^\s:]+", done.stdout.removeprefix("Axioms:\n"), re.MULTILINE))


def test_every_file_is_compiled_and_proves_what_it_says() -> None:
    there = sorted(p.name for p in PROOFS.glob("*.v"))
    assert there == sorted(FILES)
    texts = {name: (PROOFS / name).read_text(encoding="utf-8") for name in FILES}
    assert {n: UNPROVED.findall(t) for n, t in texts.items() if UNPROVED.search(t)} == {}
    assert sum(t.count("\n") for t in texts.values()) <= MOST_LINES


def test_the_theorems_rest_on_axioms_of_the_library_only(proofs: Path) -> None:
    assert assumptions(proofs, MAIN) <= LIBRARY


def test_an_axiom_of_ones_own_is_seen(proofs: Path) -> None:
    text = (
        "Axiom wrong : forall n : nat, n = 0.\nDefinition used := wrong.\nDefinition fine := 0.\n"
    )
    (proofs / "Wrong.v").write_text(text)
    assert compiled(proofs, "Wrong.v").returncode == 0
    assert assumptions(proofs, ("Wrong.used", "Wrong.fine")) == {"Wrong.wrong"}
    assert assumptions(proofs, ("Wrong.fine",)) == set()


@pytest.mark.parametrize(("name", "true", "false"), WRONG, ids=[f"{w[0]}: {w[2]}" for w in WRONG])
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
