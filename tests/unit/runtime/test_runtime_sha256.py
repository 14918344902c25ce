"""SHA-256 in C is SHA-256, whatever the lengths of text and pieces."""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING, Any

import pytest
from cffi import FFI

import processes
from soter.native.compiler import STRICT, WARNINGS, find_compiler
from soter.native.shared_library import CHECK_FAILED, RUNTIME

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture(scope="module")
def sha256(tmp_path_factory: pytest.TempPathFactory) -> Any:
    path: Path = tmp_path_factory.mktemp("sha256") / "sha256.so"
    source = str(RUNTIME / "soter_sha256.c")
    command = [
        *find_compiler().command,
        *STRICT,
        *WARNINGS,
        "-O2",
        "-fPIC",
        "-shared",
        "-o",
        str(path),
    ]
    processes.run([*command, f"-I{RUNTIME}", source, str(CHECK_FAILED)], check=True)
    ffi = FFI()
    ffi.cdef("""
        typedef struct { uint32_t h[8]; uint64_t length; uint8_t block[64]; } soter_sha256;
        void soter_sha256_start(soter_sha256 *s);
        void soter_sha256_add(soter_sha256 *s, const void *data, size_t size);
        void soter_sha256_end(soter_sha256 *s, char text[65]);
    """)
    library: Any = ffi.dlopen(str(path))

    def digest(*pieces: bytes) -> str:
        state, text = ffi.new("soter_sha256 *"), ffi.new("char[65]")
        library.soter_sha256_start(state)
        for piece in pieces:
            library.soter_sha256_add(state, ffi.from_buffer(piece), len(piece))
        library.soter_sha256_end(state, text)
        return str(ffi.string(text).decode())  # type: ignore[union-attr]

    return digest


def test_every_length_around_a_block(sha256: Any) -> None:
    for length in range(200):
        text = bytes(i % 251 for i in range(length))
        assert sha256(text) == hashlib.sha256(text).hexdigest(), length


def test_pieces_make_no_difference(sha256: Any) -> None:
    text = bytes(range(256)) * 5
    for cut in range(0, len(text), 37):
        assert sha256(text[:cut], text[cut:]) == hashlib.sha256(text).hexdigest()
