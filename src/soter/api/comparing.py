"""What a change of a program leaves standing: `compare` does what `soter diff` does.

Purpose: `compare` reads two versions, each a program or a certificate, and says which declarations
differ, which proofs stand since their problem is the same to the byte, and what hangs on the
others: times, flights and tests, requirements. Nothing is proved, compiled or run.
Non-goals: what a problem is (`verify/posed_problems.py`); accepting a certificate of another
program: `run`, `build` and `assure` ask for the program's hash.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from difflib import unified_diff
from pathlib import Path
from typing import TYPE_CHECKING, Any

from soter.addons import load_module
from soter.api.output_files import write_sections
from soter.api.rechecking import no_certificate_error
from soter.diagnostics.diagnostic import SoterError
from soter.language.front_end import CheckResult, check_file, system_of, system_of_test
from soter.language.model import typed
from soter.language.model.canonical_text import canonical_text
from soter.report.templates import PageSection
from soter.verify.posed_problems import PosedProblem, posed_problems, step_text, text_with_names

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.language.model.system import System

KINDS = {
    "consts": "const",
    "params": "param",
    "funs": "fun",
    "topics": "topic",
    "nodes": "node",
    "modules": "rta",
    "plants": "plant",
    "systems": "system",
    "tests": "test",
}
"""Table of a program -> the word that declares what is in it."""
WHATS = {
    "times": "times of steps",
    "runs": "runs of systems",
    "test": "tests",
    "requirement": "evidence for requirements",
}
"""What `also` of a headline calls each kind of consequence."""
STANDS, AGAIN, GONE, NEW, OPEN = "stands", "again", "gone", "new", "open"


@dataclass(frozen=True)
class DeclarationChange:
    """A declaration that is "changed", "gone" or "new" (`how`). `lines`: `-` old, `+` new."""

    kind: str
    name: str
    how: str
    lines: tuple[str, ...]


@dataclass(frozen=True)
class Consequence:
    """The effect of a change on a proof, times, runs of a system or test, or a requirement.

    `status`: "stands", "again" (must be made again), "gone", "new", or "open" for a requirement
    that leads to nothing here; `because`: the names of the changed declarations that are in it.
    """

    what: str
    name: str
    status: str
    because: tuple[str, ...] = ()


@dataclass(frozen=True)
class Comparison:
    """How two versions of a program differ, and which results depend on that."""

    old: str
    new: str
    declarations: tuple[DeclarationChange, ...]
    consequences: tuple[Consequence, ...]

    @property
    def again(self) -> tuple[Consequence, ...]:
        """The results that must be made again or for the first time."""
        return tuple(c for c in self.consequences if c.status in (AGAIN, NEW))

    @property
    def headline(self) -> str:
        """A sentence that says what has to be made again."""
        if not self.again:
            return "Nothing has to be made again: no proof, flight or test depends on what differs"
        proofs = [c.status for c in self.consequences if c.what == "proof"]
        counts = Counter(c.what for c in self.again if c.what != "proof")
        also = ", ".join(f"{WHATS[kind]} of {n}" for kind, n in counts.items())
        stand = f"{proofs.count(STANDS)} of {len(proofs)} proofs stand"
        return f"{stand}; to be made again, too: {also}" if also else stand

    def write_page(self, path: Path) -> None:
        """Writes the page. Raises SoterError D006 if it cannot be written."""
        changes = tuple((d.how, d.kind, d.name, "\n".join(d.lines)) for d in self.declarations)
        rows = tuple((c.what, c.name, c.status, ", ".join(c.because)) for c in self.consequences)
        sections = (
            PageSection("What differs", (), ("", "kind", "name", "lines"), changes),
            PageSection("What hangs on it", (RULE,), ("what", "of", "status", "because of"), rows),
        )
        title = f"{self.old} → {self.new}"
        write_sections(path, title, self.headline, "" if self.again else "good", sections)


RULE = (
    "A proof stands where its problem is the same to the byte. `run`, `build` and `assure` ask for "
    "a proof of the new text all the same: `soter verify --cert` makes it, with the same verdicts. "
    "Files that externs are bound to are not compared."
)


@dataclass(frozen=True)
class Version:
    """A version: its path, the checked program, and the parameters that its certificate sets."""

    path: str
    checked: CheckResult
    params: Mapping[str, Any]

    @property
    def program(self) -> typed.TypedProgram:
        """The checked program."""
        assert self.checked.program is not None
        return self.checked.program

    def declaration_lines(self, symbol: typed.Symbol | None) -> list[str]:
        """The source lines of a declaration; empty if the program's text does not contain it."""
        assert self.checked.loaded is not None
        if symbol is None:
            return []
        at = symbol.span
        declared = [d for f in self.checked.loaded.files for d in f.file.declarations]
        whole = [
            d.span
            for d in declared
            if d.span.source is at.source and d.span.start <= at.start < d.span.end
        ]
        return [x for s in whole[:1] for x in s.source.text[s.start : s.end].splitlines()]

    def posed_parts(self) -> dict[tuple[str, str], PosedProblem]:
        """Maps a kind and a name to all that is proved, timed, flown or tested."""
        parts: dict[tuple[str, str], PosedProblem] = {}
        posed = posed_problems(self.checked, self.params)
        for (system, module), problem in posed.items():
            parts["proof", f"{module} in {system}" if system else module] = problem
        for name in self.checked.systems or [""]:
            flat = system_of(self.checked, name, self.params, exact=False)
            parts |= {("times", n): text for n, text in _timed_parts(flat, posed).items()}
            parts["runs", name or "the program"] = text_with_names(flat)
        for name in self.checked.tests:
            parts["test", name] = text_with_names(system_of_test(self.checked, name, self.params))
        return parts


def compare(old: str | Path, new: str | Path, hazards: str | Path | None = None) -> Comparison:
    """Compares two programs or certificates; `hazards` is a file as for `soter assure --hazards`.

    Raises SoterError with the diagnostics of a faulty program, D009 for a folder that is not a
    certificate, D006 and D021 for `hazards`.
    """
    before, after = _read_version(Path(old)), _read_version(Path(new))
    declarations = _declaration_changes(before, after)
    changed = {d.name for d in declarations}
    olds, news = before.posed_parts(), after.posed_parts()
    consequences = [_consequence(k, olds.get(k), news.get(k), changed) for k in {**olds, **news}]
    if hazards is not None:
        consequences += _requirement_results(Path(hazards), consequences)
    return Comparison(str(old), str(new), declarations, tuple(consequences))


def _read_version(path: Path) -> Version:
    params: Mapping[str, Any] = {}
    if path.is_dir():
        from soter.certificate.reading import folder  # noqa: PLC0415 - needs NumPy

        try:
            checked, params = folder.read_program(folder.read_certificate(path))
        except folder.NotACertificateError as error:
            raise no_certificate_error(error) from None
    else:
        checked = check_file(str(path))
    if not checked.ok:
        raise SoterError(checked.diagnostics.items)
    return Version(str(path), checked, params)


# ---------------------------------------------------------------- declarations


def _declaration_changes(before: Version, after: Version) -> tuple[DeclarationChange, ...]:
    changes = []
    for table, kind in KINDS.items():
        olds, news = getattr(before.program, table), getattr(after.program, table)
        for name in {**olds, **news}:
            old, new = olds.get(name), news.get(name)
            if old is None or new is None or _declaration_text(old) != _declaration_text(new):
                how = "new" if old is None else "gone" if new is None else "changed"
                patch = unified_diff(
                    before.declaration_lines(old), after.declaration_lines(new), n=0, lineterm=""
                )
                lines = tuple(x for x in [*patch][2:] if x[0] in "+-" and x[1:].strip())
                changes.append(DeclarationChange(kind, name, how, lines))
    return tuple(changes)


def _declaration_text(symbol: typed.Symbol) -> str:
    """The text of a declaration alone; other declarations in it are replaced by their names."""

    def name_of_other_declaration(part: object) -> object:
        if isinstance(part, typed.Literal) and part.name is not None:
            return part.name
        return part.name if isinstance(part, typed.Symbol) and part is not symbol else part

    return canonical_text(symbol, name_of_other_declaration)


# ---------------------------------------------------------------- what hangs on them


def _consequence(
    key: tuple[str, str], old: PosedProblem | None, new: PosedProblem | None, changed: set[str]
) -> Consequence:
    if new is None:
        return Consequence(*key, GONE)
    if old is None:
        return Consequence(*key, NEW)
    if old.text == new.text:
        return Consequence(*key, STANDS)
    return Consequence(*key, AGAIN, tuple(sorted(changed & (old.names | new.names))))


def _timed_parts(
    flat: System, posed: Mapping[tuple[str, str], PosedProblem]
) -> dict[str, PosedProblem]:
    """By `component in system`: the code of each step of the trusted thread, and of each DM."""
    where = f" in {flat.name}" if flat.name else ""
    timed = {c.name + where: step_text(flat, c) for c in flat.components if c.in_thread and c.node}
    for m in flat.modules:  # of one that poses no problem, all of its declaration
        problem = posed.get((flat.name, m.name)) or text_with_names(m.symbol)
        timed[f"the DM of {m.name}{where}"] = problem
    return timed


def _requirement_results(path: Path, found: list[Consequence]) -> list[Consequence]:
    """The result for each hazard and requirement, from the properties that it traces to."""
    rows_of = load_module("soter.api.assurance.hazard_traceability")
    rows = [r for r in rows_of.read_hazards(path).rows if r.kind != "assumption"]
    todo = {}
    for id_, properties in rows_of.reached_properties(rows).items():
        names = {p.rpartition(".")[0] or p for p in properties}
        rests_on = [c for c in found if _concerns_names(c, names)]
        because = tuple(f"{c.what} of {c.name}" for c in rests_on if c.status != STANDS)
        status = (AGAIN if because else STANDS) if rests_on else OPEN
        todo[id_] = Consequence("requirement", id_, status, because)
    return [todo[r.id] for r in rows]


def _concerns_names(c: Consequence, names: set[str]) -> bool:
    """Whether a consequence is about a property of these modules, tests or conditions."""
    flown = c.what == "runs" and any(n.startswith(("always ", "never ")) for n in names)
    return flown or (c.what in ("proof", "test") and c.name.partition(" in ")[0] in names)
