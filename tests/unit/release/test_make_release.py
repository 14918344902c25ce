"""What `make release` promises of its archives and words; the whole of it is run by hand."""

from __future__ import annotations

import gzip
import io
import sys
import tarfile
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import processes
from soter.version import VERSION

ROOT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT))
from release import make_release  # noqa: E402 - needs the path

CONTENTS = {"soter/a.py": b"a = 1\n", "soter/run": b"#!/bin/sh\n", "soter/b.md": b"# B\n"}


def packed(order: list[str], mtime: int, owner: int, loose: int) -> bytes:
    stream = io.BytesIO()
    with tarfile.open(fileobj=stream, mode="w:gz") as archive:
        for name in order:
            member = tarfile.TarInfo(name)
            member.size, member.mtime, member.uid = len(CONTENTS[name]), mtime, owner
            member.uname = f"somebody-{owner}"
            member.mode = (0o700 if name.endswith("run") else 0o600) | loose
            archive.addfile(member, io.BytesIO(CONTENTS[name]))
    return stream.getvalue()


@given(
    st.permutations(sorted(CONTENTS)),
    st.integers(0, 2**31),
    st.integers(0, 1000),
    st.sampled_from((0, 0o044, 0o066, 0o022)),
)
def test_an_archive_has_nothing_of_the_machine(
    order: list[str], mtime: int, owner: int, loose: int
) -> None:
    made = make_release.normal(packed(order, mtime, owner, loose), 1_700_000_000)
    assert made == make_release.normal(packed(sorted(CONTENTS), 0, 0, 0o044), 1_700_000_000)
    with tarfile.open(fileobj=io.BytesIO(gzip.decompress(made))) as archive:
        read = {m.name: (m.mode, archive.extractfile(m)) for m in archive.getmembers()}
    assert {n: f.read() for n, (_, f) in read.items() if f is not None} == CONTENTS
    assert {n for n, (mode, _) in read.items() if mode & 0o111} == {"soter/run"}


@pytest.mark.parametrize("heading", ["1.2.0", "Unreleased: what will be 1.2.0", "1.2.0 (a day)"])
def test_the_notes_are_the_section_of_the_version_alone(heading: str) -> None:
    text = f"# Changelog\n\n## 1.2.0.1\nno\n\n## {heading}\n\n### All\n- new\n\n## 1.1.0\n- old\n"
    assert make_release.notes(text, "1.2.0") == "### All\n- new\n"


def test_a_version_that_the_changelog_does_not_know_has_no_notes() -> None:
    assert make_release.notes("## 1.2.0\n- new\n", "1.3.0") == ""


def test_the_changelog_has_a_section_of_this_version() -> None:
    assert make_release.notes((ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), VERSION)


def test_the_tests_of_a_release_are_there() -> None:
    assert [t for t in make_release.TESTS if not (ROOT / t).exists()] == []


def test_publishing_says_what_it_would_do_and_does_nothing(tmp_path: Path) -> None:
    made = tmp_path / "build" / "release"
    (tmp_path / "release").mkdir()
    made.mkdir(parents=True)
    script = tmp_path / "release" / "publish.sh"
    script.write_text((ROOT / "release" / "publish.sh").read_text(encoding="utf-8"))
    (made / "soter_rta-9.9-py3-none-any.whl").touch()
    (made / "soter_rta-9.9.tar.gz").touch()
    before = sorted(tmp_path.rglob("*"))
    done = processes.run(["bash", script], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    for word in (
        "gpg",
        "git tag --sign v9.9",
        "git push origin v9.9",
        "twine upload soter_rta-9.9",
    ):
        assert word in done.stdout
    assert sorted(tmp_path.rglob("*")) == before
