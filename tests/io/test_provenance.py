"""A step records what was read, and the clock can be fixed."""

from __future__ import annotations

import hashlib

import pytest

from cmm_align.errors import MissingFileError, UsageError
from cmm_align.provenance import hashed, sha256_of_file, this_step


def test_a_step_names_its_inputs_as_the_user_did(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "86400")
    (tmp_path / "a.csv").write_bytes(b"1,2,3\n")
    step = this_step("align", {"gain": 1.0}, ["a.csv"])
    assert step.time_utc == "1970-01-02T00:00:00Z"
    assert step.inputs[0].path == "a.csv"
    assert step.inputs[0].sha256 == hashlib.sha256(b"1,2,3\n").hexdigest()


def test_the_clock_is_utc(monkeypatch):
    monkeypatch.delenv("SOURCE_DATE_EPOCH", raising=False)
    assert this_step("x", {}).time_utc.endswith("Z")


def test_a_missing_input_and_a_wrong_epoch_are_named(tmp_path, monkeypatch):
    with pytest.raises(MissingFileError):
        sha256_of_file(tmp_path / "no")
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "yesterday")
    with pytest.raises(UsageError, match="yesterday"):
        this_step("x", {})


def test_files_hashed_in_the_background_give_the_same_step(tmp_path, monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "0")
    paths = [tmp_path / "a", tmp_path / "b"]
    for path in paths:
        path.write_bytes(path.name.encode() * 1000)
    assert this_step("align", {}, hashed(paths)) == this_step("align", {}, paths)
    with pytest.raises(MissingFileError):
        this_step("align", {}, hashed([tmp_path / "no"]))
