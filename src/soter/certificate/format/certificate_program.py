"""The program of a certificate, checked, and nothing read that is not part of it.

Purpose: from the files below `program/` and the parameters of the manifest to a checked program.
Non-goals: what the program says about a module (`problem.py`).
"""

from __future__ import annotations

import codecs
import hashlib
from typing import TYPE_CHECKING, Any

from soter.certificate.format.errors import RejectedError
from soter.diagnostics.diagnostic import Diagnostics, SoterError
from soter.language.elaborate.parameter_values import has_param
from soter.language.front_end import check_file
from soter.language.load.loader import load
from soter.language.model.types import BoolType, DurationType, EnumType, FloatType, IntType
from soter.language.syntax import tree

if TYPE_CHECKING:
    from soter.certificate.format.folder import Certificate
    from soter.language.front_end import CheckResult
    from soter.language.model.typed import TypedProgram


def program_of(certificate: Certificate) -> tuple[CheckResult, dict[str, Any]]:
    """The checked program and the values of its parameters; `SoterError` where it has errors.

    RejectedError where it is not in the certificate, or is another one than the manifest says.
    """
    main = certificate.manifest["main"]
    if not isinstance(main, str) or f"program/{main}" not in certificate.contents:
        raise RejectedError(f"the main file `{main}` is not in the certificate")
    path = str(certificate.folder / "program" / main)
    _only_own_files(certificate, path)
    checked = check_file(path)
    overrides: dict[str, Any] = {}
    if checked.program is not None:
        overrides = _overrides(certificate, checked.program)
        checked = check_file(path, None, overrides)
    if not checked.ok or checked.program is None:
        raise SoterError(checked.diagnostics.items)
    if checked.program.sha256 != certificate.manifest["program_sha256"]:
        raise RejectedError("the program is another one than the manifest says")
    _as_sealed(certificate, checked)
    return checked, overrides


def _as_sealed(certificate: Certificate, checked: CheckResult) -> None:
    """What was checked was read anew: every file still has the bytes that the seal is of."""
    assert checked.loaded is not None
    root = certificate.folder.resolve()
    for path, digest in checked.loaded.contents.items():
        sealed = certificate.contents[path.resolve().relative_to(root).as_posix()]
        texts = sealed, sealed.removeprefix(codecs.BOM_UTF8)
        if digest not in [hashlib.sha256(x).hexdigest() for x in texts]:
            raise RejectedError(f"`{path.name}` was changed while it was being read")


def _only_own_files(certificate: Certificate, path: str) -> None:
    """Imports and data lie in the folder, and nothing else below `program/`.

    What lies elsewhere is not sealed; what nobody reads is not part of what is checked.
    """
    diagnostics = Diagnostics()
    loaded = load(path, diagnostics)
    if loaded is None:
        raise SoterError(diagnostics.items)
    root = certificate.folder.resolve()
    paths = [f.path for f in loaded.files]
    for file in loaded.files:
        constants = [d for d in file.file.declarations if isinstance(d, tree.ConstDecl)]
        paths += [file.path.parent / d.data for d in constants if d.data is not None]
    unread = {name for name in certificate.contents if name.startswith("program/")}
    for own in paths:
        resolved = own.resolve()
        name = resolved.relative_to(root).as_posix() if resolved.is_relative_to(root) else ""
        if name not in certificate.contents:
            raise RejectedError(f"the program reads `{own.name}` outside the certificate")
        unread.discard(name)
    for name in sorted(unread):
        raise RejectedError(f"the program does not read `{name}`")


def _overrides(certificate: Certificate, program: TypedProgram) -> dict[str, Any]:
    """Values of parameters; floats are written as C99 hexadecimal texts."""
    params = certificate.manifest["params"]
    if not isinstance(params, dict):
        raise RejectedError("`params` is not as it should be")
    value_by_name = {}
    for name, value in params.items():
        param = program.param(name)
        if param is None or not has_param(program, program.systems.values(), name):
            raise RejectedError(f"the program has no parameter `{name}`")
        value_by_name[name] = _value(param.type, value, name)
    return value_by_name


def _value(of: object, value: object, name: str) -> object:
    if isinstance(of, FloatType):
        return hexadecimal(value, name)
    kind = {BoolType: bool, IntType: int, DurationType: int, EnumType: int}.get(type(of))
    if kind is None or type(value) is not kind:
        raise RejectedError(f"parameter `{name}` is not as it should be")
    if isinstance(of, EnumType) and value not in range(len(of.members)):
        raise RejectedError(f"parameter `{name}` is no member of its type")
    return value


def hexadecimal(text: object, what: str) -> float:
    """A finite number, written in the one way; RejectedError for any other text."""
    try:
        value = float.fromhex(text)  # type: ignore[arg-type]  # checked here
    except (TypeError, ValueError, OverflowError):
        raise RejectedError(f"`{what}` is no hexadecimal number") from None
    if text != value.hex() or value - value != 0.0:
        raise RejectedError(f"`{what}` is not written as it should be")
    return value
