"""The chain of commands, run once."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory, sample_data: Path) -> Path:
    """A folder in which the chain has run once; tests copy what they change."""
    from cmm_align.cli.main import outcome_of

    folder = tmp_path_factory.mktemp("chain")
    for name in ("nominal.h5", "part.csv"):
        shutil.copy(sample_data / name, folder)
    assert outcome_of(["align", str(folder / "part.csv"), str(folder / "nominal.h5"), "-q"]) == 0
    assert outcome_of(["error-map", str(folder / "part.align.h5"), "-q"]) == 0
    assert outcome_of(["compensate", str(folder / "part.map.h5"), "-q"]) == 0
    return folder
