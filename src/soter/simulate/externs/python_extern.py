"""Loads the Python code of an extern, calls it, and clips its answers.

Purpose: `load_python` makes an object of `python:file.py:name`; errors in its file, name or
construction are diagnostics (X002, X003). `PythonExtern` calls its `step` and raises nothing but
`Exception`s, and `Stop` for a person's Ctrl-C. Where the code does not fit the call
(`inputs["motion"]`, a missing name), `misuse_hint` says what an extern is called with and asked
for, with types. With `clip`, as in `soter.remote`, a number that is too large becomes the largest
that the topic takes; an infinite number or NaN is still refused. `call_with_extern_settings` calls
externs with the current folder and the recursion limit that they have set, and then restores ours,
and the rounding mode. `end_forked_copy` ends a process that an extern forked when the call ends.
Non-goals: which extern it answers (`native/extern_bindings.py`), what its answers mean
(`language/model/values.py`), crashes of the process, code that never returns (`workers/`); threads,
signals and files that an extern leaves behind; mistakes inside of the extern, which Python's own
words and line tell best.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import sys
import traceback
from contextlib import suppress
from pathlib import Path
from types import FunctionType, SimpleNamespace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from soter.diagnostics.diagnostic import Diagnostic, Label, SoterError
from soter.diagnostics.similar_names import closest
from soter.diagnostics.system_texts import reason
from soter.language.evaluate.arithmetic import restore_float_settings
from soter.language.load.named_files import read_bytes
from soter.language.model.values import without_ranges
from soter.native.extern_bindings import FilePolicy
from soter.semantics.externs import Converted, Stop, convert_answer, step_function
from soter.semantics.publication_gate import clip_to_set
from soter.simulate.externs.python_answers import MisuseError, PlainError, failure_text

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from types import ModuleType

    from soter.diagnostics.codes import Code
    from soter.diagnostics.diagnostic import Span
    from soter.language.model.system import Bound, Component, System
    from soter.language.model.types import Type
    from soter.simulate.interrupt import StopRequest

    Shapes = Sequence[tuple[str, Type]]

__all__ = ["PythonExtern", "load_python", "make_instance"]


class _ExternChanges:
    """The current folder and the recursion limit that externs have set; all externs share them."""

    folder = ""
    depth = 0


def call_with_extern_settings(call: Callable[..., object], *arguments: object) -> object:
    """Calls `call(*arguments)` of an extern with the externs' folder and recursion limit."""
    home, depth, process = _current_folder(), sys.getrecursionlimit(), os.getpid()
    if _ExternChanges.folder:
        _change_folder(_ExternChanges.folder)
    if _ExternChanges.depth > depth:
        sys.setrecursionlimit(_ExternChanges.depth)
    try:
        return call(*arguments)
    finally:
        end_forked_copy(process)
        restore_float_settings()
        _ExternChanges.depth = sys.getrecursionlimit()
        sys.setrecursionlimit(depth)
        folder = _current_folder()
        _ExternChanges.folder = folder if folder != home else ""
        if folder != home:
            _change_folder(home)


def end_forked_copy(process: int) -> None:
    """Ends the current process at once if it is a forked copy of process number `process`."""
    if os.getpid() != process:
        with suppress(OSError):
            os.write(2, b"soter: an extern forked the process: the copy ends with the call\n")
        os._exit(1)


def _current_folder() -> str:
    """The path of the current folder; "" if it was removed."""
    try:
        return os.getcwd()  # noqa: PTH109 - twice a step
    except OSError:
        return ""


def _change_folder(folder: str) -> None:
    with suppress(OSError):
        os.chdir(folder)


DEPTH = 3


def misuse_hint(error: Exception, step: object, arguments: Sequence[Any], shapes: Shapes) -> str:
    """A hint on how to write the extern; "" if its call is not the reason for the error."""
    if isinstance(error, TypeError) and _has_call_failed(error):
        return f"{_call_words(step, arguments)}{_answer_words(shapes)}"
    (inputs, *_) = arguments or (None,)
    if not isinstance(inputs, SimpleNamespace):
        return ""
    if isinstance(error, TypeError) and "SimpleNamespace" in str(error):
        names = list(vars(inputs))
        return f"its inputs are attributes: `inputs.{names[0]}`" if names else ""
    read_from = getattr(error, "obj", None)
    if isinstance(error, AttributeError) and isinstance(read_from, SimpleNamespace):
        known = list(vars(read_from))
        near = closest(str(error.name), known, 0.6, 1)
        meant = f"is `{near[0]}` meant? " if near else ""
        return f"{meant}there {'is' if len(known) == 1 else 'are'} {_name_list(known)}"
    return ""


def _has_call_failed(error: Exception) -> bool:
    """Whether the call itself failed before any code of the extern ran."""
    frames = list(traceback.walk_tb(error.__traceback__))
    return bool(frames) and frames[-1][0].f_code is call_with_extern_settings.__code__


def _call_words(step: object, arguments: Sequence[Any]) -> str:
    """A text that shows how the extern is called: with an `inputs` object or several arguments."""
    name = getattr(step, "__name__", "step")
    if len(arguments) != 1 or not isinstance(arguments[0], SimpleNamespace):
        types = ", ".join(_type_words(a) for a in arguments)
        return f"it is called with {len(arguments)} arguments ({types})"
    is_function = isinstance(step, FunctionType)
    line = f"`def {name}(inputs):`" if is_function else f"`def {name}(self, inputs):`"
    if name == "<lambda>":
        line = "`lambda inputs: ...`"
    parts = [f"`inputs.{n}` {_type_words(v)}" for n, v in vars(arguments[0]).items()]
    return f"write {line}; {', '.join(parts) or 'it has no inputs'}"


def _answer_words(shapes: Shapes) -> str:
    """A clause with the names and types that the answer should have; "" without answers."""
    if not shapes:
        return ""
    keys = ", ".join(f'"{name}": {t}' for name, t in shapes)
    return f"; it returns {{{keys}}}"


def _type_words(value: object, depth: int = DEPTH) -> str:
    """The Python type of a value in words, with the fields if it is a record."""
    if isinstance(value, SimpleNamespace):
        inner = ", ".join(f"{n}: {_type_words(v, depth - 1)}" for n, v in vars(value).items())
        return f"with {inner}" if depth == DEPTH else f"({inner})" if depth else "(...)"
    name = f"array {value.shape}" if isinstance(value, np.ndarray) else type(value).__name__
    return f"({name})" if depth == DEPTH else name


def _name_list(names: Sequence[str]) -> str:
    return ", ".join(f"`{n}`" for n in names)


_FOLDERS: set[Path] = set()
"""The folders of this process's externs."""


class ExternEscapeError(PlainError):
    """Raised if an extern tries to end the process."""


class PythonExtern:
    """An extern in this process, with `step`, and with `reset(seed)` before every run."""

    def __init__(self, name: str, target: object, stop: StopRequest, shapes: Shapes = ()) -> None:
        """`shapes`: the names and types of the outputs, which appear in hints."""
        self.name = name
        self._target = target
        self._shapes = shapes
        self._step = step_function(target)
        self._stop = stop
        self.assumed: tuple[str, ...] = target.assumed if isinstance(target, FilePolicy) else ()

    def step(self, *arguments: Any) -> object:  # noqa: ANN401 - whatever the extern takes
        """Makes a step; raises only `Exception`s, and `Stop` for a person's Ctrl-C.

        Raises `MisuseError` if the code does not fit the call. Other exceptions of the extern, such
        as `SystemExit`, become an `ExternEscapeError`.
        """
        self._stop.in_extern = True
        try:
            return call_with_extern_settings(self._step, *arguments)
        except Stop:
            raise
        except Exception as error:
            hint = misuse_hint(error, self._step, arguments, self._shapes)
            if not hint:
                raise
            raise MisuseError(f"{failure_text(error)}: {hint}") from error
        except BaseException as error:  # SystemExit and its like
            raise ExternEscapeError(failure_text(error)) from error
        finally:
            self._stop.in_extern = False

    def reset(self, seed: int) -> None:
        """Calls the object's `reset` if it exists; raises ExternEscapeError as `step` does."""
        start = getattr(self._target, "reset", None)
        if not callable(start):
            return
        self._stop.in_extern = True
        try:
            call_with_extern_settings(start, seed)
        except (Exception, Stop):
            raise
        except BaseException as error:  # of an extern a mishap like any other
            raise ExternEscapeError(failure_text(error)) from error
        finally:
            self._stop.in_extern = False


def load_python(source: str, span: Span | None) -> object:
    """Loads the object that `python:file.py:name` names; a class is instantiated.

    `span`: the place of the declaration, for diagnostics. Raises `SoterError` X003 if the file
    cannot be run, X002 if it has no such object, or if the object cannot be called.
    """
    _, file, name = source.split(":")
    target: Any = _load_module(Path(file), span)
    for part in name.split("."):
        if not hasattr(target, part):
            raise _binding_error(
                "X002", f"`{file}` has no `{name}`", span, _similar_name_hint(part, target)
            )
        target = getattr(target, part)
    if isinstance(target, type):
        target = make_instance(target, f"{file}:{name}", span)
    if not callable(getattr(target, "step", target)):
        kind = type(target).__name__
        raise _binding_error(
            "X002",
            f"`{name}` of `{file}` is a `{kind}`: it cannot be called, nor has it a `step`",
            span,
            "bind a function, or a class with a method `step`",
        )
    return target


# ---------------------------------------------------------------- files


def _load_module(path: Path, span: Span | None) -> ModuleType:
    """Loads a file as a module; each content of a file is executed only once per process."""
    try:
        content = read_bytes(path)
    except OSError as error:
        why = reason(error)
        raise _binding_error(
            "X003", f"cannot read the extern's file `{path}`: {why}", span
        ) from error
    digest = hashlib.sha256(content).hexdigest()[:16]
    full_name = f"soter_extern_{path.stem}_{digest}_{abs(hash(str(path.resolve()))):x}"
    known = sys.modules.get(full_name)
    if known is not None:
        return known
    spec = importlib.util.spec_from_file_location(full_name, path)
    if spec is None or spec.loader is None:
        raise _binding_error(
            "X003", f"`{path}` is no Python file", span, "the name of a Python file ends in .py"
        )
    module = importlib.util.module_from_spec(spec)
    _put_first_on_path(path.resolve().parent)
    sys.modules[full_name] = module
    try:
        call_with_extern_settings(spec.loader.exec_module, module)
    except KeyboardInterrupt:
        sys.modules.pop(full_name, None)
        raise
    except BaseException as error:
        sys.modules.pop(full_name, None)
        message = f"`{path}` cannot be loaded: {failure_text(error, place=False)}"
        raise _binding_error("X003", message, span, notes=_failing_line(error, path)) from error
    return module


def _put_first_on_path(folder: Path) -> None:
    """Puts an extern's folder first on `sys.path`, so that it can import the files there.

    It removes modules of the same names in other externs' folders from `sys.modules`, so that this
    extern does not get them. Code that has imported such a module keeps it.
    """
    others = _FOLDERS - {folder}
    for name, module in list(sys.modules.items()) if others else ():
        module_file, top = getattr(module, "__file__", None), name.partition(".")[0]
        theirs = module_file and any(
            _belongs_to(folder_, top, Path(module_file)) for folder_ in others
        )
        if theirs and ((folder / f"{top}.py").is_file() or (folder / top).is_dir()):
            del sys.modules[name]
    _FOLDERS.add(folder)
    if str(folder) in sys.path:
        sys.path.remove(str(folder))
    sys.path.insert(0, str(folder))


def _belongs_to(folder: Path, top: str, file: Path) -> bool:
    """Whether a file belongs to the module or package `top` in the folder."""
    return file == folder / f"{top}.py" or folder / top in file.parents


def make_instance(cls: type, name: str, span: Span | None) -> object:
    """Makes an object of a bound class; raises `SoterError` X003 if that fails."""
    try:
        return call_with_extern_settings(cls)
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        message = f"`{name}` cannot be made: {failure_text(error)}"
        help_ = "a class is instantiated without arguments"
        raise _binding_error("X003", message, span, help_) from error


def _failing_line(error: BaseException, path: Path) -> tuple[str, ...]:
    """A note that shows the failed line in the extern's file; () if the line is unknown."""
    if isinstance(error, SyntaxError):
        return (f"in line {error.lineno} of `{error.filename}`",)
    places = {str(path), str(path.absolute())}
    frames = [f for f in traceback.extract_tb(error.__traceback__) if f.filename in places]
    return (f"in line {frames[-1].lineno}: {frames[-1].line}",) if frames else ()


def _similar_name_hint(part: str, target: object) -> str:
    public = [n for n in dir(target) if not n.startswith("_")]
    close = closest(part, public)
    return f"did you mean `{close[0]}`?" if close else ""


def _binding_error(
    code: Code, message: str, span: Span | None, help_: str = "", *, notes: tuple[str, ...] = ()
) -> SoterError:
    primary = Label(span, "declared here") if span is not None else None
    helps = (help_,) if help_ else ()
    return SoterError((Diagnostic(code, message, primary, notes=notes, helps=helps),))


class Answered(NamedTuple):
    """An output of a node: its name, the type of a step's answer, and a message's type and set."""

    name: str
    step_type: Type
    type: Type
    bounds: tuple[Bound | None, ...]
    burst: bool


def node_answers(system: System, component: Component) -> tuple[Answered, ...]:
    """The outputs of an extern node, one for each topic that it publishes, in order."""
    node = component.node
    assert node is not None
    topics = [system.topics[component.scope.topics[t]] for t in node.publishes]
    return tuple(
        Answered(name, kind, topic.type, tuple(topic.bounds), symbol in node.bursts)
        for (name, kind), topic, symbol in zip(node.answers, topics, node.publishes, strict=True)
    )


def clip_target(target: object, answers: Sequence[Answered]) -> object:
    """Gives a wrapper that clips all answers if the target's `clip` is True; else the target."""
    return _Clipping(target, answers) if getattr(target, "clip", False) is True else target


class _Clipping(FilePolicy):
    def __init__(self, target: object, answers: Sequence[Answered]) -> None:
        self._step, self._answers = step_function(target), answers
        self._shapes = [(x.name, without_ranges(x.step_type)) for x in answers]
        self._reset = getattr(target, "reset", None)
        self.assumed = target.assumed if isinstance(target, FilePolicy) else ()

    def reset(self, seed: int) -> None:
        """Calls the extern's `reset` if it exists."""
        if callable(self._reset):
            self._reset(seed)

    def step(self, *arguments: Any) -> Converted:  # noqa: ANN401 - whatever the extern takes
        """The extern's answer, in which each number is clipped to its topic's set."""
        values = convert_answer(self._shapes, self._step(*arguments))
        return Converted(
            None
            if value is None
            else tuple([clip_to_set(x.type, x.bounds, message) for message in value])
            if x.burst
            else clip_to_set(x.type, x.bounds, value)
            for x, value in zip(self._answers, values, strict=True)
        )
