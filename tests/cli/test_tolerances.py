"""Tolerances as they are typed: the unit is part of the number, and what is none is refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from conftest import Ran

from cmm_align import io
from cmm_align.cli.tolerances import ToleratedLength, ToleratedSlope, in_words, with_band
from cmm_align.config import ErrorMapConfig
from cmm_align.errors import UsageError

Cli = Callable[..., Ran]


@pytest.mark.parametrize(
    ("text", "limit_um"), [("5um", 5.0), ("0.005mm", 5.0), ("0.001in", 25.4), (" 250 nm ", 0.25)]
)
def test_a_length_with_its_unit_is_taken_in_um(text: str, limit_um: float) -> None:
    assert ToleratedLength().convert(text, None, None) == pytest.approx(limit_um)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("5", "5um or 5mm"),
        ("0.005", "0.005um or 0.005mm"),
        ("0um", "above zero"),
        ("-5um", "above zero"),
        ("5parsec", "one of mm"),
        ("five um", "a number with a unit"),
        ("nanum", "a number with a unit"),
    ],
)
def test_a_length_that_is_no_tolerance_is_refused(text: str, said: str) -> None:
    with pytest.raises(UsageError) as refused:
        ToleratedLength().convert(text, None, None)
    assert said in refused.value.one_line()


@pytest.mark.parametrize(
    ("text", "mrad"),
    [("0.5mrad", 0.5), ("500 urad", 0.5), ("0.5um/mm", 0.5), ("1arcmin", 0.29089), ("60arcsec", 0.29089)],
)
def test_a_slope_with_its_unit_is_taken_in_mrad(text: str, mrad: float) -> None:
    assert ToleratedSlope().convert(text, None, None) == pytest.approx(mrad, rel=1e-4)


@pytest.mark.parametrize("text", ["0.5", "0mrad", "-1mrad", "1um", "steep"])
def test_a_slope_that_is_no_tolerance_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match=r"mrad"):
        ToleratedSlope().convert(text, None, None)


def test_a_band_is_both_ways_or_from_low_to_high() -> None:
    both, _ = with_band(ErrorMapConfig(), "5um")
    assert (both.tolerance_band_lower_um, both.tolerance_band_upper_um) == (-5.0, 5.0)
    uneven, _ = with_band(ErrorMapConfig(), "-2um, 0.008mm")
    assert (uneven.tolerance_band_lower_um, uneven.tolerance_band_upper_um) == (-2.0, pytest.approx(8.0))
    assert in_words(uneven, None) == "band -2 to +8 um; guard band 1.65 u"
    above, _ = with_band(ErrorMapConfig(decision="simple"), "1um,8um")
    assert in_words(above, None) == "band +1 to +8 um; simple acceptance"


@pytest.mark.parametrize(
    "text", ["5", "-2,8um", "-2um,8", "8um,-2um", "2um,2um", "0um", "-5um", "1um,2um,3um", "x"]
)
def test_a_band_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="--tolerance-band"):
        with_band(ErrorMapConfig(), text)


def test_a_table_of_limits_is_judged_point_by_point_and_recorded(
    cli: Cli, made: Path, tmp_path: Path
) -> None:
    alignment = io.read_alignment(made / "part.align.h5")
    table = tmp_path / "limits.csv"
    rows = [f"{k},-40,40" for k in alignment.ids]
    table.write_text("id,lower_um,upper_um\n" + "\n".join(rows) + "\n")
    start = ["error-map", made / "part.align.h5", "-o", tmp_path / "t.map.h5", "--overwrite", "--no-picture"]
    ran = cli(*start, "--tolerance-band", table, "--tolerance-slope", "9mrad", "--json")

    assert ran.code == 0
    slope, band = ran.result["conformance"]["judgements"]
    assert (slope["quantity"], slope["unit"], slope["upper"]) == ("slope", "mrad", pytest.approx(9.0))
    assert band["upper"] is None
    assert band["verdict"] == "pass"
    assert ran.result["numbers"]["points_in_tolerance"] == 1.0
    assert io.read_steps(tmp_path / "t.map.h5")[-1].inputs[1].path == str(table)
    table.write_text("id,lower_um,upper_um\n" + "\n".join(rows[:-1]) + "\n")
    assert cli(*start, "--tolerance-band", table).code == 3
    simple = cli(*start, "--tolerance-pv", "1um", "--decision", "simple")
    assert simple.code == 5
    assert "simple acceptance" in simple.out
    assert "cmm-align compensate" in simple.out
    numbers = ran.result["numbers"]
    between = 0.5 * (numbers["points_pv_um"] + numbers["pv_without_noise_um"])
    open_one = cli(*start, "--tolerance-pv", f"{between}um")
    assert open_one.code == 6
    assert "measure again, with more points" in open_one.out  # as on page and card
    assert "cmm-align compensate" not in open_one.out


def test_a_map_of_a_few_nodes_is_warned_of(cli: Cli, made: Path, tmp_path: Path) -> None:
    ran = cli(
        "error-map", made / "part.align.h5", "-o", tmp_path / "f.map.h5", "--spacing", "20mm", "--no-picture"
    )

    assert "form between them is not seen" in ran.err
