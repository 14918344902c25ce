from __future__ import annotations

import inspect
from pathlib import Path

import pytest

import soter
from soter.language import front_end
from soter.native import cache
from soter.native.cache import SOTER, files_below, soter_sha256
from soter.verify.deploy import missing_predicates


def test_a_folder_without_such_files_is_a_defect_and_no_empty_list(tmp_path: Path) -> None:
    (tmp_path / "deeper").mkdir()
    with pytest.raises(FileNotFoundError, match="soter is not whole"):
        files_below(tmp_path, "*.c")
    (tmp_path / "deeper" / "a.c").touch()
    assert files_below(tmp_path, "*.c", "*.h") == [tmp_path / "deeper" / "a.c"]


def test_kept_sets_depend_on_every_file_of_the_engine_however_deep() -> None:
    files = set(missing_predicates.engine_files())
    assert Path(inspect.getfile(soter)).parent == SOTER
    for module in (missing_predicates, front_end):
        assert Path(inspect.getfile(module)) in files
    engine = list(SOTER.rglob("soter_reach*.[ch]"))
    assert len(engine) > 10
    assert set(engine) <= files
    assert set((SOTER / "verify").rglob("*.py")) <= files


def test_whatever_soter_is_made_of_changes_its_hash(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def hashed() -> str:
        soter_sha256.cache_clear()
        return soter_sha256()

    whole = hashed()
    kinds = {p.suffix for p in SOTER.rglob("*") if p.suffix in {".py", ".c", ".h", ".soter"}}
    assert len(kinds) == 4
    monkeypatch.setattr(cache, "SOTER", tmp_path)
    told = {whole}
    for name in ("a.py", "b.c", "deeper/c.h", "deeper/prelude.soter"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("x")
        told.add(hashed())
        (tmp_path / name).write_text("y")
        told.add(hashed())
    (tmp_path / "a.py").rename(tmp_path / "d.py")
    told.add(hashed())
    assert len(told) == 10, "each of these is another Soter"
    soter_sha256.cache_clear()
