"""Generated programs and the kernel run clean under AddressSanitizer and UBSan.

An executable is built, because a sanitized library does not load into Python. It runs random
programs, every example and every small program of the tests, each in a heap block of exactly its
state's size; the final states must be the interpreter's.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

import processes
from generators.engine_comparison import (
    final_states,
    first_difference,
    interpreted_trace,
    subject,
)
from generators.random_programs import program
from generators.shipped_programs import files, subjects_of
from long_tests import examples, seeds
from soter.native.compiler import find_compiler
from soter.native.shared_library import RUNTIME

if TYPE_CHECKING:
    from pathlib import Path

    from generators.engine_comparison import Subject

FLAGS = (
    "-O1", "-g", "-fsanitize=address,undefined", "-fsanitize=float-cast-overflow",
    "-fno-sanitize-recover=all",
)  # fmt: skip
INSTANTS = 400
PROGRAMS = examples(8)
CHUNKS = max(2, PROGRAMS // 7)


@pytest.fixture(scope="module")
def _sanitizers(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Skip, visibly, where the compiler has no sanitizers."""
    folder = tmp_path_factory.mktemp("sanitizers")
    (folder / "empty.c").write_text("int main(void) { return 0; }\n")
    command = [
        *find_compiler().command,
        *FLAGS,
        "-o",
        str(folder / "empty"),
        str(folder / "empty.c"),
    ]
    built = processes.run(command, capture_output=True, check=False)
    if built.returncode != 0 or processes.run([str(folder / "empty")], check=False).returncode != 0:
        pytest.skip("this compiler has no ASan and UBSan")


def compare(subjects: list[Subject], folder: Path) -> None:
    states = final_states(subjects, folder, *FLAGS)
    for s, state in zip(subjects, states, strict=True):
        native = np.frombuffer(state, dtype=np.uint8).reshape(1, -1)
        assert first_difference(s, native, interpreted_trace(s)[-1:]) is None, s.name


@pytest.mark.usefixtures("_sanitizers")
@pytest.mark.parametrize("chunk", range(CHUNKS))
@pytest.mark.random
def test_random_programs_run_clean(chunk: int, tmp_path: Path) -> None:
    numbers = seeds(30_000 + chunk, 30_000 + PROGRAMS, CHUNKS)
    compare([subject(f"p{n}", program(n), n, INSTANTS) for n in numbers], tmp_path)


@pytest.mark.usefixtures("_sanitizers")
@pytest.mark.parametrize(
    "folder",
    [
        pytest.param("examples/drone", marks=pytest.mark.long),
        *("examples/wall", "tests/correct", "tests/dynamic_error", "tests/corners"),
    ],
)
@pytest.mark.long
@pytest.mark.long
@pytest.mark.long
def test_programs_of_the_repository_run_clean(folder: str, tmp_path: Path) -> None:
    subjects = [s for path in files(folder) for s in subjects_of(path, INSTANTS)]
    assert subjects, folder
    compare(subjects, tmp_path)


@pytest.mark.usefixtures("_sanitizers")
def test_the_sanitizers_would_complain(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A kernel that clears one byte too many is noticed."""
    kernel = (RUNTIME / "soter_kernel.c").read_text()
    cheated = tmp_path / "kernel.c"
    cheated.write_text(kernel.replace("0, p->state_size)", "0, p->state_size + 1U)"))
    sources = [str(cheated), str(RUNTIME / "soter_virtual.c")]
    monkeypatch.setattr("generators.engine_comparison.kernel_sources", lambda: sources)
    with pytest.raises(AssertionError, match="heap-buffer-overflow"):
        final_states([subject("p1", program(1), 1, 10)], tmp_path, *FLAGS)
