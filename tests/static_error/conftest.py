"""Programs of this folder import each other by their names alone."""

from __future__ import annotations

import pytest


@pytest.fixture(autouse=True)
def _in_this_folder(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(request.path.parent)
