"""`soter build FILE --target c -o DIR`: a program as sources for a target.

Purpose: writes the package, tells what is in it and what to do next, and bounds its stack.
Non-goals: the package itself (`targets/`).
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

from soter.api.deploy.building import built_image, stack_bound
from soter.cli.terminal.child_process import fork_into_child
from soter.cli.terminal.command_outcome import CommandOutcome
from soter.cli.terminal.console import Console, ProgressBar
from soter.cli.terminal.program_loading import loaded_program, warn_of_extern_files
from soter.cli.terminal.shared_options import CERTIFICATE_FOLDER, SET, SYSTEM, file_option
from soter.diagnostics.command_records import option
from soter.native.stack_bound import OPTIMISE, StackBound
from soter.targets.package import TARGETS, Package

if TYPE_CHECKING:
    import argparse

    from soter.cli.terminal.command_line import Pairs
    from soter.targets.cortex_m_image import Image

PAGES = ", ".join(dict.fromkeys(t.page for t in TARGETS.values() if t.page))
EXAMPLES = f"""\
  soter build cart.soter --target c -o cart_c && make -C cart_c && cart_c/cart
  soter build cart.soter --system Unprotected -o out
  soter build robot.soter -o out --bind Learned=c:policy.c:policy_step
  soter build robot.soter --system Vehicle --target ros1 --map robot.toml --cert proof/ -o robot_ros

in the folder that is written: the program as C, the C of Soter that it needs, inherited.json where
it deploys what was proved; of c and posix README.md, which says what each file is, of the others a
package for their build tool ({PAGES})

{CERTIFICATE_FOLDER}"""


DEFAULT = next(iter(TARGETS))
NAMES = " or ".join(f"{t} (the default)" if t == DEFAULT else t for t in TARGETS)


def _target_names(*, mapped: bool = False, boarded: bool = False) -> str:
    """The names of the targets that take a mapping or a board, joined by commas."""
    return ", ".join(n for n, t in TARGETS.items() if (t.mapped, t.boarded) == (mapped, boarded))


@dataclass(frozen=True, kw_only=True)
class Options:
    """Write C99, or a package for a target."""

    file: str = file_option()
    target: str = option("--target T", DEFAULT, NAMES)
    output: str = option("-o --output DIR", ..., "folder to write")
    system: str | None = option(*SYSTEM)
    cert: str | None = option(
        "--cert DIR",
        None,
        "of a system that `deploys` another: the certificate of that one; checked again",
    )
    board: str | None = option(
        "--board B",
        None,
        f"of {_target_names(boarded=True)}: a board, or its file (docs/bare-metal.md)",
    )
    map: str | None = option(
        "--map FILE",
        None,
        f"of {_target_names(mapped=True)}: which topic is which of its messages (docs/mapping.md)",
    )
    params: Pairs = option(*SET)


def run(args: argparse.Namespace, console: Console) -> CommandOutcome:
    """Writes the package and prints what is in it; for a board it also builds the image."""
    program = warn_of_extern_files(loaded_program(args, console), console)
    if program.externs and args.board is not None:  # they answer in the run that an image repeats
        fork_into_child(console, lambda _: ())
    with ProgressBar(console) as progress:
        package = program.build(
            args.target,
            args.output,
            args.system,
            dict(args.params),
            cert=args.cert,
            mapping=args.map,
            board=args.board,
            progress=progress,
        )
        stack = stack_bound(package, args.board)
        image = built_image(package, args.board, stack)
    _say_package(package, stack, image, console)
    fields: dict[str, object] = {
        "target": package.target,
        "output": str(package.folder),
        "program_sha256": program.sha256,
        "written": package.written,
        "kept": package.kept,
        "notes": package.notes,
        "inherited": package.inherited or None,
        "stack": asdict(stack),
        "image": None if image is None else asdict(image),
        "commands": package.commands,
    }
    return CommandOutcome(fields=fields)


def _say_package(
    package: Package, stack: StackBound, image: Image | None, console: Console
) -> None:
    text = f"{len(package.written)} files, target {package.target}"
    console.say(f"{console.paint('green', 'built')}  {package.folder}  {text}")
    for name in package.kept:
        console.say(f"kept   {package.folder / name}, which is yours")
    for line in package.inherits:
        console.say(f"inherits  {line}")
    if stack.bytes is None:
        console.say(f"stack  no bound: {stack.why}")
    else:
        optimised = "" if image is not None else f", {OPTIMISE}"
        rest = f", and of {', '.join(stack.not_counted)}" if stack.not_counted else ""
        console.say(f"stack  at most {stack.bytes:,} bytes{rest} ({stack.compiler}{optimised})")
        console.say(f"       {' > '.join(stack.way)}")
    for line in [] if image is None else image.text_lines():
        console.say(f"image  {line}")
    for note in package.notes:
        console.say(f"{console.paint('yellow', 'note')}   {note}")
    console.say("\nnext\n" + "\n".join(f"  {command}" for command in package.commands))
