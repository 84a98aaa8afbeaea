"""The command: a certificate for the auditor, a verdict for the shell."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from conftest import Ran

from cmm_align.selftest import checks
from cmm_align.selftest.finding import Finding

Cli = Callable[..., Ran]


def quick(error: float) -> tuple[checks._Case, ...]:
    """Two checks that cost nothing."""
    return (
        checks._Case("lengths", lambda: [Finding("a length", error, "nm", 3)]),
        checks._Case("angles", lambda: [Finding("an angle", 1e-12, "rad", 1)]),
    )


@pytest.fixture
def cases(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[[float], None]:
    monkeypatch.chdir(tmp_path)

    def use(error: float) -> None:
        monkeypatch.setattr(checks, "CHECKS", quick(error))
        monkeypatch.setattr("cmm_align.selftest.CHECKS", quick(error))

    return use


def test_a_good_build_passes_and_its_certificate_says_what_was_compared(
    cli: Cli, cases: Callable[[float], None], tmp_path: Path
) -> None:
    cases(1e-5)
    ran = cli("selftest", "--json")
    [path] = tmp_path.glob("cmm-align-selftest-*.json")
    certificate = json.loads(path.read_text())

    assert ran.code == 0
    assert ran.json["outputs"] == [path.name]
    assert ran.result["largest_error_nm"] == 1e-5
    assert ran.result["largest_error_rad"] == 1e-12
    assert certificate["passed"] is True
    assert certificate["stated_error_nm"] == 1.0
    assert certificate["checks"][0]["findings"] == [
        {"what": "a length", "error_nm": 1e-5, "limit_nm": 1.0, "n": 3}
    ]
    assert {"numpy", "scipy", "h5py", "pyserial"} <= set(certificate["libraries"])


@pytest.mark.parametrize("error", [1.5, float("nan")])
def test_a_bad_build_fails_and_still_leaves_its_certificate(
    cli: Cli, cases: Callable[[float], None], tmp_path: Path, error: float
) -> None:
    cases(error)
    ran = cli("selftest", "-o", "c.json")

    assert ran.code == 5
    assert "FAIL" in ran.out
    assert "not passed: lengths" in ran.out
    assert "do not use" in ran.out
    assert json.loads((tmp_path / "c.json").read_text())["passed"] is False


def test_a_certificate_is_not_replaced_unasked(
    cli: Cli, cases: Callable[[float], None], tmp_path: Path
) -> None:
    cases(0.0)
    (tmp_path / "c.json").write_text("{}")
    ran = cli("selftest", "-o", "c.json")

    assert ran.code == 8
    assert (tmp_path / "c.json").read_text() == "{}"


def test_a_folder_that_is_not_there_is_found_before_the_checks_run(
    cli: Cli, cases: Callable[[float], None]
) -> None:
    cases(0.0)
    ran = cli("selftest", "-o", "nowhere/c.json")

    assert ran.code == 8
    assert "nowhere" in ran.err


@pytest.mark.parametrize("name", ["part.csv", "part.comp.h5", "settings.toml"])
def test_a_certificate_is_named_as_one(
    cli: Cli, cases: Callable[[float], None], tmp_path: Path, name: str
) -> None:
    cases(1e-5)
    (tmp_path / name).write_text("# cmm-align points v1; units=mm\n")

    ran = cli("selftest", "-o", name, "--overwrite")

    assert ran.code == 2
    assert ".json" in ran.err
    assert (tmp_path / name).read_text().startswith("# cmm-align points")


def test_a_certificate_replaces_certificates_alone(
    cli: Cli, cases: Callable[[float], None], tmp_path: Path
) -> None:
    cases(1e-5)
    (tmp_path / "mine.json").write_text('{"hello": 1}\n')

    assert cli("selftest", "-o", "mine.json", "--overwrite").code == 8
    assert cli("selftest", "-o", "new.json").code == 0
    assert cli("selftest", "-o", "new.json", "--overwrite").code == 0
