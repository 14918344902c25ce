"""`Program`: a program and everything that can be done with it; each command is one method.

Purpose: `load` makes a `Program`. Other packages are imported when they are needed, so that `check`
loads neither NumPy nor cffi. Non-goals: the work itself (other packages), printing (`cli/`).
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from soter.addons import load_module
from soter.api.arguments import chosen_modules, format_text, read_params, read_text, run_end_ns
from soter.api.check_report import CheckReport, add_stale_monitors, check_report
from soter.api.computed_ttf import compute_ttf
from soter.api.output_files import (
    opened_run_log,
    require_no_certificate,
    require_utf8,
    require_writable,
    require_writers,
    write_advice,
)
from soter.diagnostics.command_records import make_record, refuse_needless, takes
from soter.diagnostics.current_phase import whole_shares_to
from soter.diagnostics.diagnostic import Diagnostic, SoterError, mistake
from soter.language.evaluate.statements import python_function
from soter.language.front_end import CheckResult, check_file, system_of
from soter.language.model.values import to_python
from soter.version import VERSION

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from typing_extensions import Unpack

    from soter.api.arguments import Progress, Tell
    from soter.api.diagrams import Diagram
    from soter.api.running import PreparedSystems
    from soter.campaign.result import Campaign
    from soter.explore.results import ExploreReport
    from soter.explore.search_options import SearchKeywords
    from soter.language.model.system import System
    from soter.language.model.typed import TypedProgram
    from soter.language.model.types import Value
    from soter.monitor.log_judgement import LogJudgement
    from soter.monitor.model_membership import Judgement
    from soter.native.extern_bindings import Bindings
    from soter.report.safety_case import Assurance
    from soter.simulate.result import Run
    from soter.simulate.run_options import RunKeywords
    from soter.targets.package import Package
    from soter.verify.claims.results import ProofSearch, VerifyReport
    from soter.verify.deploy.missing_predicates import Known
    from soter.verify.period_advice import Advice, DelayAdvice

    Params = Mapping[str, object] | None


def load(path: str | Path, progress: Tell | None = None, text: str | None = None) -> Program:
    """Reads and checks the program in a file; `progress` is called with a note on slow work.

    It never fails: errors are in `.diagnostics`, and methods that need a sound program raise
    `SoterError`. `text` replaces the file's text; imports are read from the file's folder.
    """
    return Program(str(path), progress, text)


class Program:
    """A checked program with the targets that its externs are bound to."""

    def __init__(self, path: str, progress: Tell | None = None, text: str | None = None) -> None:
        self.path = path
        self._checked: CheckResult = check_file(path, text, tell=progress)
        add_stale_monitors(self._checked)
        self._bound: dict[str, object] = {}
        self._flat: list[System] = []  # `bind` looks for names in these

    def __repr__(self) -> str:
        return f"<soter.Program {self.path}: {', '.join(self.systems) or 'no systems'}>"

    @cached_property
    def _prepared(self) -> PreparedSystems:
        from soter.api.running import PreparedSystems  # noqa: PLC0415 - see the docstring

        return PreparedSystems()

    @property
    def diagnostics(self) -> tuple[Diagnostic, ...]:
        """All errors and warnings of the check."""
        return self._checked.diagnostics.items

    @property
    def ok(self) -> bool:
        """Whether the program has no error."""
        return self._checked.ok

    @property
    def systems(self) -> tuple[str, ...]:
        """Names of the systems that the program declares."""
        return tuple(self._checked.systems)

    @property
    def externs(self) -> tuple[str, ...]:
        """Names of the nodes, plants and functions that the program leaves to Python or C."""
        program = self._checked.program
        return () if program is None else program.externs

    @property
    def sha256(self) -> str | None:
        """SHA-256 hash over all source and data files; None if no file could be read."""
        return self._checked.program.sha256 if self._checked.program is not None else None

    def check(self, params: Params = None, *, times: str | Path | None = None) -> CheckReport:
        """Reports on a sound program, else raises SoterError; `times`: file of `soter measure`."""
        values = self._param_values(params)
        flat = self._checked.flat if self.ok and not values and times is None else {}
        if len(flat) < len(self.systems):
            flat = {n: system_of(self._checked, n, values, exact=False) for n in self.systems}
        return check_report(self.path, self._checked, flat, self._bound, times)

    def constant(self, name: str) -> Any:  # noqa: ANN401 - any Soter value
        """The value of a constant by full name (`city.GOALS`), as externs get it; else KeyError."""
        symbol = self._require_sound().consts[name]
        return to_python(symbol.type, symbol.value)

    def function(self, name: str) -> Callable[..., Any]:
        """A function of the program as a callable, which may raise `StepFault`. Raises KeyError."""
        program = self._require_sound()
        return python_function(program, program.funs[name])

    def format(self) -> str:
        """The main file in the standard layout. Raises SoterError if it does not parse."""
        return format_text(self.path, read_text(self.path))

    def bind(self, name: str, target: object) -> Program:
        """Lets `target` answer the extern `name` in all later runs, and returns this program.

        `name`: a full name (`d.M.Learned`), its last part, or the declared name. `target`: a
        callable, an object or class with `step` and perhaps `reset(seed)`, or a text:
        `python:file.py:name`, `c:file.c:name`, or for a policy `onnx:file.onnx`, `sb3:file.zip`,
        `sb3:file.zip:vecnormalize.pkl` (relative to the current folder). Raises SoterError U005 if
        no system has this extern, U001, X002 or X003 for a wrong target.
        """
        from soter.native.extern_bindings import check_target, require_extern  # noqa: PLC0415 - as above

        check_target(name, target)
        if self.ok:
            self._flat = self._flat or [system_of(self._checked, s) for s in self.systems]
            require_extern(self._flat, name)
        self._bound[name] = target
        return self

    def unbind(self, name: str) -> Program:
        """Undoes `bind(name, ...)`: the program's `from` applies again. Raises SoterError U005."""
        if name not in self._bound:
            known = "bound is " + (", ".join(f"`{n}`" for n in self._bound) or "nothing")
            raise mistake("U005", f"nothing was bound as `{name}`", known)
        del self._bound[name]
        return self

    # ------------------------------------------------------------ running

    @takes("soter.simulate.run_options.RunOptions")
    def simulate(
        self,
        system: str | None = None,
        until: float | str | None = None,
        seed: int = 1,
        engine: str = "native",
        params: Mapping[str, object] | None = None,
        **options: Unpack[RunKeywords],
    ) -> Run:
        """Runs a system in virtual time, or against the clock with `real_time` (docs/real-time.md).

        Times are seconds, or texts such as `"30s"`. `log` is written during the run; a `report`
        keeps the whole trace. Ctrl-C, and with a log also SIGTERM and SIGHUP, ends the run at an
        instant and raises KeyboardInterrupt (the others end the process), or with `partial` returns
        the part that was run. Raises SoterError U001 for wrong options.
        """
        from soter.api.running import simulate  # noqa: PLC0415 - see the docstring
        from soter.simulate.run_options import RunOptions  # noqa: PLC0415 - the same

        how = make_record(RunOptions, {"until": until, "seed": seed, "engine": engine, **options})
        values = self._param_values(params)
        with whole_shares_to(how.progress):
            prepared = self._prepared.prepared_system(self._checked, system, values, self._bound)
        if how.arm is not None:
            prepared = self._prepared.system_of_arm(prepared, how.arm, how.campaign)
        log, writer = how.log, opened_run_log(how.log)
        require_writers(log if isinstance(log, (str, Path)) else None, how.report)
        report = None if how.report is None else Path(how.report).absolute()  # externs may move
        how = replace(how, trace=how.trace if report is None else True)
        until_ns = 0 if how.recorded is not None else run_end_ns(prepared.system, until)
        bound = dict(self._bound)
        run = simulate(self._prepared, prepared, bound, how, until_ns=until_ns, writer=writer)
        if writer is not None and writer is not log and writer.problem is not None:
            raise writer.problem
        if report is not None:
            self.write_report(run, report)
        return run

    def campaign(self, system: str | None = None, params: Any = None, **how: Any) -> Campaign:  # noqa: ANN401
        """Flies many seeds of a system, as `soter.api.campaigning.campaign` describes."""
        require_utf8(how.get("output"))
        bindings = self._bindings(self._completed(system, params, bound=self._bound)[0])
        flown = load_module("soter.api.campaigning").campaign(bindings, self.path, **how)
        return cast("Campaign", flown)

    def write_log(self, run: Run, path: str | Path) -> Path:
        """Writes the MCAP log of a traced run. Raises SoterError D006 or D007."""
        from soter.simulate.run_log import write_log  # noqa: PLC0415 - an extra

        require_utf8(path)
        return write_log(run, path, VERSION)

    def write_report(self, run: Run, path: str | Path, *, self_contained: bool = False) -> Path:
        """Writes a traced run's HTML report, the script beside it or in it. Raises D006, D007."""
        from soter.api.running import write_report  # noqa: PLC0415 - see the docstring

        require_utf8(path)
        return write_report(run, path, self.path, self_contained=self_contained)

    def build(
        self,
        target: str,
        output: str | Path,
        system: str | None = None,
        params: Mapping[str, object] | None = None,
        *,
        cert: str | Path | None = None,
        mapping: str | Path | Mapping[str, Any] | None = None,
        board: str | None = None,
        progress: Progress | None = None,
    ) -> Package:
        """Writes the package of a target (`"c"`) into the folder `output`.

        `cert`: a certificate of the system that this one deploys; it is checked again. `mapping`:
        for targets with a middleware (docs/mapping.md), a file or its content. `board`: for
        `"cortex-m"`, the name of a board or its file (docs/bare-metal.md). `progress` is called
        with the finished share. Raises SoterError D015 for a wrong mapping, D019 or D020 for a
        wrong certificate, X017 for an unknown board.
        """
        from soter.api.deploy.building import build  # noqa: PLC0415 - see the docstring

        require_utf8(output, cert, mapping, board)
        fresh, completed = self.declared(system, params), partial(self._completed, system, params)
        with whole_shares_to(progress):
            how: dict[str, Any] = {"cert": cert, "mapping": mapping, "board": board}
            return build(target, Path(output), fresh, completed, self._bindings, **how)

    def monitor(
        self,
        log: str | Path | None = None,
        module: str | None = None,
        *,
        system: str | None = None,
        until: float | str | None = None,
        seed: int = 1,
        params: Mapping[str, object] | None = None,
        estimates: bool = False,
    ) -> list[Judgement]:
        """Judges whether any run of the verification plants fits a log, or a new run.

        `log`: from `soter run --log` of the same system. `estimates`: judge measurements instead of
        the true states. Raises SoterError U001 if a plant is not affine.
        """
        require_utf8(log)
        refuse_needless(
            "beside `log`", until=None not in (log, until), seed=log is not None and seed != 1
        )
        flat = self.flat(system, params)
        run = None if log is not None else self.simulate(system, until, seed, params=params)
        judge = load_module("soter.api.monitoring").judge_modules
        judged = judge(flat, log, run, module, estimates=estimates)
        return cast("list[Judgement]", judged)

    def judge_log(self, log: Any, mapping: Any, **how: Any) -> LogJudgement:  # noqa: ANN401
        """Judges a log of another system by a mapping, as `soter.api.monitoring.judge_log` does."""
        judged = load_module("soter.api.monitoring").judge_log(self.flat, log, mapping, **how)
        return cast("LogJudgement", judged)

    def assure(self, output: str | Path, **how: Any) -> Assurance:  # noqa: ANN401
        """Writes a safety case, as `soter.api.assurance.safety_case.assure` does."""
        require_utf8(output, *how.values())
        case = load_module("soter.api.assurance.safety_case").assure(self, output, **how)
        return cast("Assurance", case)

    def emit_monitor(
        self,
        path: str | Path,
        module: str | None = None,
        *,
        system: str | None = None,
        params: Mapping[str, object] | None = None,
        alarm: str | None = None,
    ) -> Path:
        """Writes the model monitor of a module as a trusted Soter node, and returns the path.

        `alarm`: the bool topic to publish, by default a new topic. Raises SoterError D006.
        """
        require_utf8(path)
        flat = self.declared(system, params)
        chosen = chosen_modules(flat, module)[0]
        write = load_module("soter.monitor.emitted_monitors").write_monitor
        return cast("Path", write(flat, chosen, self.path, Path(path), alarm=alarm, params=params))

    def verify(
        self,
        module: str | None = None,
        cert: str | Path | None = None,
        *,
        system: str | None = None,
        params: Mapping[str, object] | None = None,
        synthesize: bool = False,
        refute: bool = True,
        explain: bool | None = None,
        report: str | Path | None = None,
        progress: Progress | None = None,
        budget_s: float = 120.0,
    ) -> VerifyReport:
        """Proves P1c, P2a, P2b, P3, `ttf`, `safer` and `failsafe` of all modules, or of `module`.

        `module`: full or declared name. `system`: the system with the plants; by default the first
        that has the module, beginning with the default system. `cert`: a folder for a certificate;
        `report`: an HTML page. `synthesize`: first find the controllers that are `sc synthesized`,
        then verify the program that was written. `refute`: look for counterexamples if a proof
        fails; `explain`: measure why it fails and try remedies (None: as `refute`). `budget_s`: CPU
        seconds for the search of hints if the program bounds no states; the report is then about
        the program with these hints (`VerifyReport.searches`). Raises R... if it poses no problem.
        """
        from soter.verify.command import verify  # noqa: PLC0415 - needs NumPy and a compiler

        self._require_sound()
        require_utf8(cert, report)
        if synthesize and (written := self.synthesize(module=module, system=system, params=params)):
            how: dict[str, Any] = {"refute": refute, "explain": explain, "report": report}
            how |= {"system": system, "params": params, "progress": progress, "budget_s": budget_s}
            return load(written[0]).verify(module, cert, **how)
        require_writers(None, report)
        if report is not None and cert is not None:
            require_no_certificate(Path(report), Path(cert))
        if refute:
            from soter.explore.command import find_violating_run  # noqa: PLC0415 - needs a compiler
        with whole_shares_to(progress):
            return verify(
                self._checked,
                module=module,
                system=system,
                params=self._param_values(params),
                written_params=params,
                cert=None if cert is None else Path(cert),
                refute=refute,
                explain=explain,
                report=None if report is None else Path(report),
                search=find_violating_run if refute else None,
                budget_s=budget_s,
            )

    def synthesize(
        self,
        output: str | Path | None = None,
        *,
        module: str | None = None,
        system: str | None = None,
        params: Mapping[str, object] | None = None,
    ) -> tuple[Path, ...]:
        """Finds every safe controller left open (`sc synthesized period d;`), writes the program.

        `output`: by default `<name>_sc.soter`; it must lie in the program's folder. Returns the
        written files, first the program; () if no controller is open. Raises SoterError U009 if no
        controller was found.
        """
        from soter.verify.find_sc import synthesize  # noqa: PLC0415 - needs NumPy and a compiler

        self._require_sound()
        path = Path(self.path)
        target = path.with_name(f"{path.stem}_sc.soter") if output is None else Path(output)
        how: Any = {"module": module, "system": system, "params": self._param_values(params)}
        return tuple(synthesize(self._checked, target, **how))

    def advise(
        self,
        module: str | None = None,
        *,
        system: str | None = None,
        params: Mapping[str, object] | None = None,
        levels: Sequence[int] = (2, 3, 4),
        factors: Sequence[float] = (0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0),
        report: str | Path | None = None,
        progress: Progress | None = None,
    ) -> tuple[Advice, ...]:
        """Finds the effect of the period and the number of levels of every decision module.

        `factors`: multiples of the declared period; `levels`: numbers of levels (m); `report`: an
        HTML file with the plot. Raises R... if a problem is not determined, D006 or D007.
        """
        from soter.verify.chosen_modules import modules_of, problems_of  # noqa: PLC0415 - the same
        from soter.verify.period_advice import sweep_all  # noqa: PLC0415 - needs NumPy and a compiler

        if report is not None:
            require_writable(Path(report))
        chosen = modules_of(self._checked, module, system, self._param_values(params))
        with whole_shares_to(progress):
            advice = sweep_all(problems_of(chosen), factors, levels)
        if report is not None and advice:
            write_advice(advice, self.path, Path(report))
        return tuple(advice)

    def largest_delays(
        self,
        module: str | None = None,
        *,
        system: str | None = None,
        params: Mapping[str, object] | None = None,
        progress: Progress | None = None,
    ) -> tuple[DelayAdvice, ...]:
        """Finds by proof how late commands of each module may act, in ns. Raises SoterError R..."""
        from soter.verify.chosen_modules import modules_of  # noqa: PLC0415 - the same
        from soter.verify.period_advice import largest_delay  # noqa: PLC0415 - needs a compiler

        chosen = modules_of(self._checked, module, system, self._param_values(params))
        with whole_shares_to(progress):
            return tuple(largest_delay(flat, m) for flat, m in chosen)

    def rest_clauses(self, budget_s: float = 120.0, **what: Any) -> tuple[ProofSearch, ...]:  # noqa: ANN401
        """Looks for a `rest` that proves: `budget_s` CPU s a module; `what` as `largest_delays`."""
        from soter.verify.search.searched_program import searches_for_rest  # noqa: PLC0415 - needs a compiler

        what = {"module": None, "system": None, "params": None, **what}
        what["params"] = self._param_values(what["params"])
        with whole_shares_to(what.pop("progress", None)):
            return searches_for_rest(self._checked, what, budget_s)

    @takes("soter.explore.search_options.SearchOptions")
    def explore(
        self, test: str | Sequence[str] | None = None, **options: Unpack[SearchKeywords]
    ) -> ExploreReport:
        """Explores every execution of all tests or of some (docs/testing.md).

        A violation has a trace that the interpreter has replayed: the least, if found in `minimise`
        seconds. It is written to the folder `output` (None: not), and as a page if `html`. Times
        are seconds; `skew` and `horizon` may be text. Ctrl-C raises `KeyboardInterrupt`, or with
        `partial` returns what was covered. SoterError U001 for options.
        """
        from soter.api.exploring import explore  # noqa: PLC0415 - needs NumPy and a compiler

        self._require_sound()
        return explore(self._checked, self.path, {"test": test, **options})

    def _require_sound(self) -> TypedProgram:
        if not self._checked.ok:
            raise SoterError(self.diagnostics)
        assert self._checked.program is not None
        return self._checked.program

    def _param_values(self, params: Mapping[str, object] | None) -> dict[str, Value]:
        return read_params(self._require_sound(), params)

    def flat(self, system: str | None = None, params: Mapping[str, object] | None = None) -> System:
        """A new flat system as it runs: all numbers known, instances named, predicates computed."""
        return self._completed(system, params)[0]

    def declared(self, system: str | None = None, params: Params = None) -> System:
        """A flat system as in `flat`, but without the computed predicates."""
        return system_of(self._checked, system, self._param_values(params))

    def diagram(self, system: str | None = None, params: Params = None) -> Diagram:
        """The diagram of a system: its nodes, topics, modules and plants."""
        from soter.api.diagrams import diagram_of  # noqa: PLC0415 - only then

        return diagram_of(self.declared(system, params))

    @property
    def bound(self) -> Mapping[str, object]:
        """Maps the name of an extern to the target that `bind` got for it."""
        return dict(self._bound)

    def _completed(
        self,
        name: str | None,
        params: Params,
        known: Known | None = None,
        bound: Mapping[str, object] | None = None,
    ) -> tuple[System, list[str]]:
        """A fresh flat system with all `ttf` and `safer`, and a note on each computed predicate."""
        system = self.declared(name, params)
        return system, compute_ttf(system, known, bound)

    def _bindings(self, system: System) -> Bindings:
        from soter.native.extern_bindings import bind  # noqa: PLC0415 - see the docstring

        return bind(system, self._bound)
