"""Objects of the run-time in the cache: compiled once, and never linked when damaged."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from soter.diagnostics.diagnostic import SoterError
from soter.native.compiler import find
from soter.native.objects import kept_objects

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture
def sources(tmp_path: Path) -> tuple[Path, ...]:
    for name in ("one", "two"):
        (tmp_path / f"{name}.c").write_text(
            f"int {name}(void);\nint {name}(void) {{ return 1; }}\n"
        )
    return tmp_path / "one.c", tmp_path / "two.c"


def kept(sources: tuple[Path, ...], folder: Path, content: str = "a" * 64) -> tuple[str, ...]:
    folder.mkdir(exist_ok=True)
    return kept_objects(sources, find().command, folder, content)


def test_objects_are_compiled_once(sources: tuple[Path, ...], tmp_path: Path) -> None:
    first = kept(sources, tmp_path / "cache")
    (tmp_path / "one.c").unlink()
    assert kept(sources, tmp_path / "cache") == first
    assert [name.rsplit("/", 1)[1] for name in first] == ["one.o", "two.o"]


def test_other_content_is_compiled_anew(sources: tuple[Path, ...], tmp_path: Path) -> None:
    assert kept(sources, tmp_path / "cache") != kept(sources, tmp_path / "cache", "b" * 64)


@pytest.mark.parametrize("damage", [b"", b"half", None])
def test_a_damaged_object_is_compiled_anew(
    sources: tuple[Path, ...], tmp_path: Path, damage: bytes | None
) -> None:
    first = tmp_path / "cache" / kept(sources, tmp_path / "cache")[0]
    whole = first.read_bytes()
    if damage is None:
        first.unlink()
    else:
        first.write_bytes(damage)
    kept(sources, tmp_path / "cache")
    assert first.read_bytes() == whole


def test_what_does_not_compile_is_said_in_the_compilers_words(tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.c"
    wrong.write_text("int wrong(void) { return missing; }\n")
    with pytest.raises(SoterError, match="X004") as caught:
        kept((wrong,), tmp_path / "cache")
    assert any("missing" in note for note in caught.value.diagnostics[0].notes)
