"""What the tests share: where the real atria are, and phantoms made once a session."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "Testing" / "Host"))

from slicer_host.pytest_hooks import host, host_with_qt, host_with_views  # noqa: E402

__all__ = ["host", "host_with_qt", "host_with_views"]


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """Folder of the real atria; tests that ask for it skip where it is absent."""
    folder = Path(os.environ.get("LAF_TEST_DATA", ROOT.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"real atria not found at {folder} (set LAF_TEST_DATA)")
    return folder


@pytest.fixture(scope="session")
def phantom():
    """The open synthetic atrium at 2,000 points."""
    from LAFlatteningLib.phantom import make_phantom

    return make_phantom(2000)


@pytest.fixture(scope="session")
def phantom_map(phantom):
    """Its regional map."""
    from LAFlatteningLib.flattening import flatten

    return flatten(phantom.surface, phantom.seeds)
