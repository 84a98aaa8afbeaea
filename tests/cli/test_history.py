"""The ledger on the command line: a chain of two passes, what it tells, and what it refuses."""

from __future__ import annotations

import json
import shutil
import sqlite3
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest
from conftest import Ran

from cmm_align.io import ledger_file
from cmm_align.io.ledger_file import adding_pass, create_ledger, read_ledger

Cli = Callable[..., Ran]


@pytest.fixture(scope="module")
def two_passes(made: Path, sample_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a ledger of two passes."""
    from cmm_align.cli.main import outcome_of

    folder = tmp_path_factory.mktemp("ledger")
    for name in ("nominal.h5", "part.map.h5"):
        shutil.copy(made / name, folder)
    shutil.copy(sample_data / "part2.csv", folder)
    ledger = ["--ledger", str(folder / "window.sqlite"), "--no-picture", "-q"]
    first, second = str(folder / "part.map.h5"), str(folder / "part2.map.h5")
    assert outcome_of(["compensate", first, "--part", "W12", *ledger]) == 0
    assert outcome_of(["align", str(folder / "part2.csv"), str(folder / "nominal.h5"), "-q"]) == 0
    assert outcome_of(["error-map", str(folder / "part2.align.h5"), "--no-picture", "-q"]) == 0
    assert outcome_of(["compensate", second, "--previous", str(folder / "part.comp.h5"), *ledger]) == 0
    return folder


def test_a_second_pass_fills_what_came_of_the_first_and_keeps_its_part(two_passes: Path) -> None:
    one, two = read_ledger(two_passes / "window.sqlite").passes
    assert (one.part, one.pass_number, two.part, two.pass_number) == ("W12", 1, "W12", 2)
    assert one.came is not None
    assert one.came.rms_um == two.rms_um
    assert one.came.map_digest == two.map_digest
    assert two.previous_map_digest == one.map_digest
    long = one.came.bands[0]
    assert long is not None
    # the part was ground by a virtual machine with a transfer of 0.96
    assert long.transfer == pytest.approx(0.96, abs=2.0 * long.u_transfer)


def test_the_learned_transfer_is_in_the_result_in_the_file_and_in_the_gain(
    cli: Cli, two_passes: Path
) -> None:
    ran = cli(
        "compensate", two_passes / "part2.map.h5", "--previous", two_passes / "part.comp.h5", "--json",
        "--ledger", two_passes / "window.sqlite", "-o", two_passes / "again.h5", "--no-picture",
    )  # fmt: skip
    result = json.loads(ran.out)["result"]
    learned = result["ledger"]["learned"]
    assert (result["ledger"]["part"], result["ledger"]["n_passes"]) == ("W12", 2)
    assert learned[0]["n_passes"] == 1
    assert learned[0]["gain"] == pytest.approx(
        learned[0]["transfer"] / (learned[0]["transfer"] ** 2 + learned[0]["u_transfer"] ** 2), rel=1e-9
    )
    assert result["transfer"][-1] == learned[0]["transfer"]
    assert len(read_ledger(two_passes / "window.sqlite").passes) == 2  # the same pass is there once


def test_what_was_given_goes_before_what_was_learned(cli: Cli, two_passes: Path) -> None:
    ran = cli(
        "compensate", two_passes / "part2.map.h5", "--previous", two_passes / "part.comp.h5", "--transfer",
        "0.9", "--ledger", two_passes / "window.sqlite", "-o", two_passes / "told.h5", "--no-picture",
    )  # fmt: skip
    assert ran.code == 0
    assert "goes before the one that window.sqlite has learned" in ran.err
    assert "with a transfer of 0.9" in ran.out


def test_history_shows_passes_transfer_wear_and_predictions(cli: Cli, two_passes: Path) -> None:
    picture, table = two_passes / "h.png", two_passes / "h.csv"
    ran = cli("history", two_passes / "window.sqlite", "--plot", picture, "--csv", table)
    assert ran.code == 0
    for text in ("2 passes of 1 part", "W12", "waves over 31 mm", "wheel wear", "of 1 within their 95 %"):
        assert text in ran.out
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert len(table.read_text(encoding="utf-8").splitlines()) == 3
    again = cli("history", two_passes / "window.sqlite", "--plot", picture)
    assert again.code == 8
    result = json.loads(cli("history", two_passes / "window.sqlite", "--json").out)["result"]
    assert result["passes"][0]["came"]["rms_um"] == result["passes"][1]["rms_um"]
    assert result["passes"][1]["came"] is None
    assert (result["n_passes"], result["parts"], result["n_predictions"]) == (2, ["W12"], 1)


def test_a_dressing_is_noted_once_and_shown(cli: Cli, two_passes: Path, tmp_path: Path) -> None:
    ledger = shutil.copy(two_passes / "window.sqlite", tmp_path)
    ran = cli("history", ledger, "--wheel", "D20", "--json")
    assert [d["after_passes"] for d in json.loads(ran.out)["result"]["dressings"]] == [2]
    refused = cli(
        "compensate",
        two_passes / "part.map.h5",
        "--ledger",
        ledger,
        "--wheel",
        "D46",
        "-o",
        tmp_path / "x.h5",
        "--first-pass",
    )
    assert refused.code == 3
    assert "the ledger is of wheel D20" in refused.err


def test_what_does_not_fit_the_ledger_is_refused_and_nothing_is_written(
    cli: Cli, two_passes: Path, tmp_path: Path
) -> None:
    ledger = Path(shutil.copy(two_passes / "window.sqlite", tmp_path))
    with closing(sqlite3.connect(ledger)) as base:
        base.execute("UPDATE ledger SET nominal_digest = 'of another part'")
        base.commit()
    before = ledger.read_bytes()
    start = ["compensate", two_passes / "part.map.h5", "--first-pass", "-o", tmp_path / "x.h5"]
    other = cli(*start, "--ledger", ledger)
    assert (other.code, "the ledger is of another nominal" in other.err) == (3, True)
    ground = cli(*start, "--ledger", two_passes / "window.sqlite", "--gain", "0.5")
    assert (ground.code, "was ground with another correction" in ground.err) == (3, True)
    (tmp_path / "notes.txt").write_text("PV 27.3", encoding="utf-8")
    notes = cli(*start, "--ledger", tmp_path / "notes.txt")
    assert (notes.code, "is no ledger" in notes.err) == (3, True)
    assert cli(*start, "--part", "W1").code == 2
    assert ledger.read_bytes() == before
    assert sorted(p.name for p in tmp_path.iterdir()) == ["notes.txt", "window.sqlite"]


def test_outputs_that_cannot_be_written_leave_no_new_ledger(
    cli: Cli, two_passes: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from cmm_align import io
    from cmm_align.errors import OutputError

    def full(*_: object, **__: object) -> None:
        raise OutputError("disk full")

    monkeypatch.setattr(io, "write", full)
    ledger = tmp_path / "new.sqlite"
    ran = cli(
        "compensate", two_passes / "part.map.h5", "--first-pass", "--ledger", ledger, "-o", tmp_path / "x.h5"
    )
    assert ran.code == 8
    assert not ledger.exists()


def test_an_empty_ledger_says_that_it_is(cli: Cli, two_passes: Path, tmp_path: Path) -> None:
    ledger = tmp_path / "new.sqlite"
    create_ledger(ledger, replace(read_ledger(two_passes / "window.sqlite"), passes=()))
    empty = cli("history", ledger)
    assert (empty.code, "no pass yet" in empty.out) == (0, True)
    assert cli("history", ledger, "--plot", tmp_path / "h.png").code == 3
    assert cli("history", ledger, "--part", "W1").code == 2


def test_a_ledger_that_another_run_holds_is_code_8_with_who(
    cli: Cli, two_passes: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from dataclasses import replace

    monkeypatch.setattr(ledger_file, "TIMEOUT_S", 0.0)
    ledger = Path(shutil.copy(two_passes / "window.sqlite", tmp_path))
    row = replace(read_ledger(ledger).passes[0], part="W13", map_digest="of another part")
    with adding_pass(ledger, row, None):
        ran = cli("history", ledger, "--dressed")
    assert ran.code == 8
    assert "is writing it" in ran.err


def test_info_knows_a_ledger(cli: Cli, two_passes: Path) -> None:
    ran = cli("info", two_passes / "window.sqlite")
    assert "a ledger of passes" in ran.out
    assert f"cmm-align history {two_passes / 'window.sqlite'}" in ran.out


def test_no_ledger_is_an_input_that_is_missing(cli: Cli, tmp_path: Path) -> None:
    assert cli("history", tmp_path / "none.sqlite").code == 3
    assert list(tmp_path.iterdir()) == []
