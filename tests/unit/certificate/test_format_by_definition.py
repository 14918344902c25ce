"""What a folder, a table and a text of a certificate may be, each at the bounds it is held to."""

from __future__ import annotations

import hashlib
import itertools
import math
import os
import struct
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from soter.certificate import proof_methods
from soter.certificate.reading import folder as folders
from soter.certificate.reading.folder import (
    FORMAT,
    Certificate,
    NotACertificateError,
    canonical_json,
    read_certificate,
)
from soter.certificate.report import NotRecheckedError, RejectedError

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray


def of_files(folder: Path, **contents: bytes) -> Certificate:
    """A certificate with these tables."""
    return Certificate(folder, {}, {f"sets/{n}": data for n, data in contents.items()}, set())


# ---------------------------------------------------------------- tables


@pytest.mark.parametrize(
    "numbers",
    [
        (),
        (1.0,),
        (1.0, 1.0),
        (2.0, 1.0),
        (1.0, math.inf),
        (-math.inf, 1.0),
        (1.0, math.nan),
        (math.nan, 1.0),
        (0.0, 1.0, 1.0),
        (0.0, 0.0, 1.0),
        (0.0, 2.0, 1.0),
    ],
)
def test_edges_that_are_none(tmp_path: Path, numbers: tuple[float, ...]) -> None:
    data = struct.pack(f"<{len(numbers)}d", *numbers)
    with pytest.raises(RejectedError):
        of_files(tmp_path, x=data).breakpoints("sets/x")


def test_edges_are_eight_bytes_each_and_rise(tmp_path: Path) -> None:
    for numbers in ((1.0, 2.0), (-1e300, 0.0, 5e-324, 1e300)):
        data = struct.pack(f"<{len(numbers)}d", *numbers)
        assert of_files(tmp_path, x=data).breakpoints("sets/x") == numbers
        for other in (data + b"\0", data[:-1], data + b"\0" * 7):
            with pytest.raises(RejectedError, match="no breakpoints"):
                of_files(tmp_path, x=other).breakpoints("sets/x")


def test_a_table_has_a_number_for_each_cell(tmp_path: Path) -> None:
    for shape, (kind, size) in itertools.product(
        ((4,), (2, 3), (3, 1, 2)), (("<u1", 1), ("<u2", 2))
    ):
        count = math.prod(shape)
        numbers = [(7 * k) % 256 for k in range(count)]
        data = b"".join(n.to_bytes(size, "little") for n in numbers)
        table = of_files(tmp_path, x=data).number_table("sets/x", shape, kind)
        assert table.shape == shape
        assert table.ravel().tolist() == numbers
        for other in (data[:-1], data + b"\0", b""):
            with pytest.raises(RejectedError, match="size"):
                of_files(tmp_path, x=other).number_table("sets/x", shape, kind)


@pytest.mark.parametrize("shape", [(1,), (7,), (8,), (9,), (3, 5), (2, 2, 2), (4, 4)])
def test_a_set_has_a_bit_for_each_cell(tmp_path: Path, shape: tuple[int, ...]) -> None:
    count = math.prod(shape)
    for pattern in (0, 1, 1 << (count - 1), 0b10110 % (1 << count), (1 << count) - 1):
        size = (count + 7) // 8
        found = of_files(tmp_path, x=pattern.to_bytes(size, "little")).set_of_cells("sets/x", shape)
        assert found.shape == shape
        assert found.ravel().tolist() == [bool(pattern >> k & 1) for k in range(count)]
        for bit in range(count, 8 * size):
            data = (pattern | 1 << bit).to_bytes(size, "little")
            with pytest.raises(RejectedError, match="behind the last cell"):
                of_files(tmp_path, x=data).set_of_cells("sets/x", shape)


def test_a_table_is_named_as_it_is_and_noted(tmp_path: Path) -> None:
    contents = {"sets/a": b"a", "sets/b": b"b", "program/c": b"c", "sets/d": b"d"}
    certificate = Certificate(tmp_path, {}, contents, set())
    assert certificate.table_bytes("sets/b") == b"b"
    assert certificate.unused_tables == ["sets/a", "sets/d"]
    for path in ("program/c", "sets/e", "a", 3, None, ["sets/a"], b"sets/a"):
        with pytest.raises(RejectedError, match="no table"):
            certificate.table_bytes(path)
    assert certificate.unused_tables == ["sets/a", "sets/d"]


# ---------------------------------------------------------------- the manifest


def test_canonical_is_one_way_to_write_it() -> None:
    assert canonical_json({"b": [1, "\xe9"], "a": None}) == b'{"a":null,"b":[1,"\\u00e9"]}\n'
    with pytest.raises(ValueError, match="JSON"):
        canonical_json(math.nan)


@pytest.mark.parametrize(
    "raw",
    [
        b"",
        b"\xff",
        b"[]\n",
        b'"text"\n',
        b"{}",
        b"{} \n",
        b'{"b":1,"a":2}\n',
        b'{"a":NaN}\n',
        b'{"a":1,"a":1}\n',
        b"[" * 200_000,
    ],
)
def test_a_manifest_that_is_none(raw: bytes) -> None:
    with pytest.raises(RejectedError, match="manifest"):
        folders._parse_manifest(raw)


def test_a_manifest_is_what_it_says() -> None:
    manifest = {"a": [1, {"b": 2.5}], "c": ""}
    assert folders._parse_manifest(canonical_json(manifest)) == manifest


@pytest.mark.parametrize("given", [True, False, "2", 2.0, None, [], 0, -1])
def test_a_format_that_is_no_version(given: object) -> None:
    with pytest.raises(RejectedError, match="version"):
        folders._require_this_format(given)


def test_another_version_is_not_known() -> None:
    folders._require_this_format(FORMAT)
    for given in {1, 2, 3, 99} - {FORMAT}:
        with pytest.raises(NotRecheckedError, match="older" if given < FORMAT else "newer"):
            folders._require_this_format(given)


# ---------------------------------------------------------------- the folder


def sealed(folder: Path, contents: dict[str, bytes], **manifest: Any) -> Path:
    """A certificate whose hashes are right."""
    hashes = {name: hashlib.sha256(data).hexdigest() for name, data in contents.items()}
    for name, data in contents.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)
    raw = canonical_json({"schema": FORMAT, "files": hashes, **manifest})
    (folder / "manifest.json").write_bytes(raw)
    (folder / "SEAL").write_text(hashlib.sha256(raw).hexdigest() + "\n")
    return folder


RIGHT = {"program/a": b"1", "sets/b": b"22", "sets/c/d": b""}


def test_a_folder_is_read_as_it_is(tmp_path: Path) -> None:
    certificate = read_certificate(sealed(tmp_path, RIGHT))
    assert certificate.contents == RIGHT
    assert certificate.used == set()
    seal = (tmp_path / "SEAL").read_text().strip()
    assert certificate.seal == seal


@pytest.mark.parametrize("left_out", ["manifest.json", "SEAL", "both", "the folder"])
def test_what_is_no_certificate(tmp_path: Path, left_out: str) -> None:
    folder = sealed(tmp_path, RIGHT)
    for name in ("manifest.json", "SEAL"):
        if left_out in (name, "both"):
            (folder / name).unlink()
    if left_out == "the folder":
        folder = folder / "SEAL"
    with pytest.raises(NotACertificateError):
        read_certificate(folder)


@pytest.mark.parametrize(
    ("name", "word"),
    [("program/a", "missing"), ("sets/e", "not listed"), ("other", "not listed")],
)
def test_files_are_those_that_are_listed(tmp_path: Path, name: str, word: str) -> None:
    folder = sealed(tmp_path, RIGHT)
    if word == "missing":
        (folder / "sets/more").write_bytes(b"")
        sealed(folder, {**RIGHT, "sets/more": b""})
        (folder / name).rename(folder / "program/b")
        (folder / "program/b").unlink()
        (folder / "program").rmdir()
    else:
        (folder / name).write_bytes(b"")
    with pytest.raises(RejectedError, match=word):
        read_certificate(folder)


@pytest.mark.parametrize("name", ["other", "sets2/x", "programs/x", "SETS/x"])
def test_files_lie_below_two_folders(tmp_path: Path, name: str) -> None:
    with pytest.raises(RejectedError, match="outside"):
        read_certificate(sealed(tmp_path, {**RIGHT, name: b"x"}))


@pytest.mark.parametrize("name", sorted(RIGHT))
def test_each_file_is_covered(tmp_path: Path, name: str) -> None:
    folder = sealed(tmp_path, RIGHT)
    (folder / name).write_bytes(b"3")
    with pytest.raises(RejectedError, match="was changed"):
        read_certificate(folder)


@pytest.mark.parametrize("text", ["", "no newline", "two newlines"])
def test_the_seal_is_one_line(tmp_path: Path, text: str) -> None:
    folder = sealed(tmp_path, RIGHT)
    seal = (folder / "SEAL").read_text()
    written = {"": "", "no newline": seal[:-1], "two newlines": seal + "\n"}[text]
    (folder / "SEAL").write_text(written)
    with pytest.raises(RejectedError, match="seal"):
        read_certificate(folder)


def test_so_many_files_and_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Folders count as files do: three files and two folders."""
    for name in ("a/x", "a/b/y", "z"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(b"")
    for most in range(4, 7):
        monkeypatch.setattr(folders, "ENTRIES_MAX", most)
        if most >= 5:
            assert list(folders._file_sizes(tmp_path)) == ["a/b/y", "a/x", "z"]
        else:
            with pytest.raises(NotRecheckedError, match="more than 4 files"):
                folders._file_sizes(tmp_path)


@pytest.mark.parametrize(
    ("name", "most"),
    [("manifest.json", 3), ("program/x", 5), ("sets/x", 7), ("SEAL", 7), ("a/program/x", 7)],
)
def test_a_file_is_no_larger_than_its_kind_may_be(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, most: int
) -> None:
    for limit, value in (("MANIFEST_MAX", 3), ("PROGRAM_MAX", 5), ("FILE_MAX", 7)):
        monkeypatch.setattr(folders, limit, value)
    path = tmp_path / name
    path.parent.mkdir(parents=True, exist_ok=True)
    for size in (most - 1, most, most + 1):
        path.write_bytes(b"x" * size)
        if size <= most:
            assert folders._file_sizes(tmp_path) == {name: size}
        else:
            with pytest.raises(NotRecheckedError, match="too many to be read"):
                folders._file_sizes(tmp_path)


def test_all_files_together_are_so_large(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, size in (("a", 3), ("b", 4)):
        (tmp_path / name).write_bytes(b"x" * size)
    for most in (6, 7, 8):
        monkeypatch.setattr(folders, "BYTES_MAX", most)
        if most >= 7:
            assert folders._file_sizes(tmp_path) == {"a": 3, "b": 4}
        else:
            with pytest.raises(NotRecheckedError, match="larger than 6"):
                folders._file_sizes(tmp_path)


def test_a_folder_is_needed_by_a_file(tmp_path: Path) -> None:
    (tmp_path / "a/b/c").mkdir(parents=True)
    (tmp_path / "a/b/c/file").write_bytes(b"")
    assert folders._file_sizes(tmp_path) == {"a/b/c/file": 0}
    (tmp_path / "a/d").mkdir()
    with pytest.raises(RejectedError, match="`a/d` is empty"):
        folders._file_sizes(tmp_path)


@pytest.mark.skipif(os.name != "posix", reason="POSIX has pipes and links that are files")
@pytest.mark.parametrize("kind", ["pipe", "link", "folder"])
def test_only_a_plain_file_is_read(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "x"
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "link":
        (tmp_path / "file").write_bytes(b"")
        path.symlink_to("file")
    else:
        path.mkdir()
        (path / "file").write_bytes(b"")
    if kind != "folder":
        with pytest.raises(RejectedError, match="neither a file nor a folder"):
            folders._file_sizes(tmp_path)
    with pytest.raises((RejectedError, NotRecheckedError)):
        folders._read_file(tmp_path, "x", 0)


def test_what_the_system_refuses_is_not_read(tmp_path: Path) -> None:
    for ask in (
        lambda: list(folders._folder_entries(tmp_path / "none")),
        lambda: folders._read_file(tmp_path, "none", 0),
    ):
        with pytest.raises(NotRecheckedError, match="cannot be read"):
            ask()


# ---------------------------------------------------------------- what claims rest on


def test_each_part_rests_on_a_claim_that_is_made() -> None:
    """By the list in docs/verification.md: R on P3, `ttf`, `safer`; Q and W on P2b."""
    free, home = {"P3", "ttf", "safer"}, {"P2b"}
    rests = {"R": free, "Q": home, "W": home, "W_N": home}
    for part, claim in itertools.product((*rests, "K", "S"), (*sorted(free | home), "P2a", "P1a")):
        for computed in (False, True):
            wrong = (part == "S" and not computed) or claim not in rests.get(part, {claim})
            if part == "S" and computed:
                wrong = False
            found = proof_methods.parts_without_claim(
                {"kind": "grid", part: []}, {claim}, computed=computed
            )
            assert found == ([part] if wrong else [])
            groups = [{"kind": "grid"}, {"kind": "grid", part: []}]
            if wrong:
                with pytest.raises(RejectedError, match=f"`{part}`"):
                    proof_methods.refuse_parts_without_claim(groups, {claim}, computed=computed)
            else:
                proof_methods.refuse_parts_without_claim(groups, {claim}, computed=computed)


@pytest.mark.parametrize("claim", ["P2a", "start", "P2b", "P3", "ttf", "safer", "P1a"])
def test_k_and_the_time_to_return_rest_on_claims(claim: str) -> None:
    def of(*members: bool) -> NDArray[np.bool_]:
        return np.array(members)

    for cells, back in itertools.product(
        ([], [of(False)], [of(False), of(False, True)]), (None, 0, 5)
    ):
        held, returns = len(cells) == 2, back is not None
        if (held and claim == "P1a") or (returns and claim != "P2b"):
            with pytest.raises(RejectedError):
                folders.refuse_cells(cells, {claim}, back)
        else:
            folders.refuse_cells(cells, {claim}, back)


def test_an_entry_has_its_keys_and_no_others() -> None:
    def ask(*keys: str) -> None:
        folders.require_keys(dict.fromkeys(keys), "a b", "it", "c d")

    for more in itertools.chain.from_iterable(itertools.combinations("cd", n) for n in range(3)):
        ask("a", "b", *more)
    for missing in ("a", "b"):
        with pytest.raises(RejectedError, match=f"has no `{missing}`"):
            ask(*({"a", "b"} - {missing}))
    with pytest.raises(RejectedError, match="an unknown `e`"):
        ask("a", "b", "e")
    for entry in (["a", "b"], "a b", None):
        with pytest.raises(RejectedError, match="not as it should be"):
            folders.require_keys(entry, "a b", "it")
