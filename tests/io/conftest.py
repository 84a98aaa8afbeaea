"""Small nouns of every kind, and a comparison that looks into arrays."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np
import pytest

from cmm_align.model import (
    Alignment,
    Change,
    ChangeBand,
    ChangeRung,
    Comparison,
    Conformance,
    Correction,
    CorrectionBand,
    CorrectionLimits,
    DeviationMap,
    DoubtfulTouch,
    Equidistant,
    FitReport,
    FitStep,
    GateCheck,
    GatedExport,
    GateReport,
    Irregularity,
    Judgement,
    LadderRung,
    MadeBy,
    MapNumbers,
    Nominal,
    NominalQuality,
    PassPrediction,
    PassResponse,
    ProcessTransfer,
    RootCauses,
    Seat,
    SlopeError,
    Statistics,
    Verdict,
    frozen_array,
)
from cmm_align.model.root_causes import Cause, Member
from cmm_align.pose import Pose, rotation_from_vector
from cmm_align.provenance import InputFile, Step
from cmm_align.surfaces.spline_surface import SplineSurface


def _frozen(array: Any) -> Any:
    array.flags.writeable = False
    return array


def _spline(rng: np.random.Generator, ny: int, nx: int, degree: int) -> SplineSurface:
    return SplineSurface(
        "grid",
        -3.5,
        1.25,
        0.1,
        0.3,
        degree,
        _frozen(rng.normal(size=(ny + degree, nx + degree))),
        _frozen(rng.random((ny, nx)) > 0.2),
    )


def _nominal() -> Nominal:
    rng = np.random.default_rng(1)
    n = 300
    smooth = _spline(rng, 4, 5, 3)
    net = Equidistant(
        nominal_points_mm=_frozen(rng.normal(size=(n, 3))),
        normals=_frozen(rng.normal(size=(n, 3))),
        slope=_frozen(rng.random(n)),
        gaussian_curvature_per_mm2=_frozen(rng.normal(size=n)),
        points_mm=_frozen(rng.normal(size=(n, 3))),
        triangles=_frozen(rng.integers(0, n, size=(500, 3), dtype=np.int32)),
        regular=_frozen(rng.random(n) > 0.1),
    )
    quality = NominalQuality(
        n_points=n,
        max_slope_deg=31.25,
        min_concave_radius_mm=None,
        min_concave_at_mm=(1.5, -2.0),
        regular=True,
        facet_error_pv_nm=12.5,
        surface_error_pv_nm=0.1,
        equidistant_error_pv_nm=0.3,
        spacing_mm=(0.1, 0.3),
        degree=5,
    )
    return Nominal(
        surface=_spline(rng, 20, 30, 5),
        side=-1,
        tip_radius_mm=1.5,
        surface_from_part=Pose(
            rotation_from_vector(np.array([0.1, 2.0, -0.3])), np.zeros(3), "surface", "part"
        ),
        digest="ab" * 32,
        equidistant=net,
        equidistant_surface=smooth,
        quality=quality,
    )


def _alignment(n: int = 400) -> Alignment:
    rng = np.random.default_rng(2)
    deviation = rng.normal(size=n)
    deviation[3] = np.nan
    return Alignment(
        nominal=replace(_nominal(), equidistant=None, equidistant_surface=None),
        part_from_machine=Pose(
            rotation_from_vector(np.array([0.3, -0.2, 3.0])),
            np.array([100.0, 1 / 3, -5.0]),
            "part",
            "machine",
        ),
        covariance=_frozen(rng.normal(size=(6, 6))),
        tip_centre_machine_mm=_frozen(rng.normal(size=(n, 3))),
        tip_centre_part_mm=_frozen(rng.normal(size=(n, 3))),
        contact_part_mm=_frozen(rng.normal(size=(n, 3))),
        normals=_frozen(rng.normal(size=(n, 3))),
        deviation_mm=_frozen(deviation),
        used=_frozen(rng.random(n) > 0.5),
        judged=_frozen(rng.random(n) > 0.3),
        status=_frozen(rng.integers(0, 6, n).astype(np.uint8)),
        sigma_mm=_frozen(rng.random(n)),
        ids=_frozen(np.arange(n)[::-1].copy()),
        report=FitReport(
            iterations=7,
            stop_reason="step below 1e-12",
            converged=True,
            unobservable=("rotation about z",),
            pose_sigma={"tx_um": 0.1, "rz_urad": 1 / 3},
            two_path_difference_nm=0.25,
            steps=(FitStep("way", 0.0, 1.0, 9), FitStep("all", 0.1, 1e-9 / 3, 8)),
            distance="smooth",
            n_outside=1,
            n_outliers=0,
        ),
    )


def _statistics(seed: int) -> Statistics:
    r = np.random.default_rng(seed).normal(size=9).tolist()
    return Statistics(17, r[0], r[1], r[2], r[3], r[4], (r[5], r[6]), (r[7], r[8]))


def _numbers() -> MapNumbers:
    """Every field with a value of its own; what may be unknown partly unknown."""
    values: dict[str, Any] = {
        field.name: 0.1 + k / 3 for k, field in enumerate(fields(MapNumbers)) if field.name.endswith("_um")
    }
    values |= {
        "percentiles_um": {"0.1": -1 / 3, "99.9": 2 / 3},
        "band_um": (-1.0, 2.0),
        "min_at_mm": (1.0, -1 / 3),
        "max_at_mm": (0.5, 2.0),
    }
    irregularity = Irregularity(*(k / 7 for k in range(len(fields(Irregularity)))))
    return MapNumbers(
        n_nodes=17,
        n_points=18,
        points_in_tolerance=0.99,
        area_in_tolerance=None,
        slope=SlopeError(0.1, None, 0.2, 0.3, 0.25, 1 / 3, (1.0, 2.0), 4, 3.0, "gradient"),
        irregularity=replace(irregularity, u_b_um=None),
        made_by=MadeBy(
            "least-squares",
            "smooth",
            "foot-point",
            "equal",
            "area",
            ("rz",),
            "part",
            1.0,
            "",
            "",
            "",
            1,
            2,
            "",
        ),
        **values,
    )


def _cause() -> Cause:
    other = Member("stylus radius", 3.0, 0.25, "um", None, "+ = add to the radius that was entered", 1.0)
    numbers = (0.75, 0.125, 1.25, 0.5, 1e12)
    return Cause("wheel radius", -3.0, 0.25, "um", None, 2.5, "+", "set that first", *numbers, (other,))


def _map() -> DeviationMap:
    rng = np.random.default_rng(3)
    grid = rng.normal(size=(3, 12, 40))
    grid[:, 0, :5] = np.nan
    return DeviationMap(
        alignment=_alignment(),
        x_mm=_frozen(np.linspace(-1, 1, 40)),
        y_mm=_frozen(np.linspace(-2, 2, 12)),
        deviation_mm=_frozen(grid[0]),
        sag_deviation_mm=_frozen(grid[1]),
        sigma_mm=_frozen(grid[2]),
        statistics=_statistics(4),
        point_statistics=_statistics(5),
        pvr_mm=0.1,
        u_rms_mm=1e-6,
        ladder=(LadderRung("nothing", 1.0, 0.5, 1.5), LadderRung("rigid motion", 0.9, 0.4, 1.1)),
        verdict=Verdict.UNDECIDED,
        spacing_mm=0.05,
        coverage=0.75,
        verdict_lines=("PV 4.95 um <= 10 um: pass",),
        method="local quadratic",
        window_steps=1.5,
        root_causes=RootCauses((_cause(),), "", ("wheel radius",), (), 1.5, 0.5, 400, 256, 12.5, (0.5, -1.0)),
        comparison=_comparison(),
        numbers=_numbers(),
        conformance=Conformance(
            "guard-band",
            1.65,
            (
                Judgement("PV", "um", 5.0, 4.9, 0.1, None, 10.0, 5.1, 1.0, "pass", "PV 5 um <= 10 um: pass"),
                Judgement("band", "um", -0.1, -0.2, 0.1, -3.0, 5.0, 0.2, 0.97, "undecided", "band: open"),
            ),
            0.97,
        ),
    )


def _comparison() -> Comparison:
    rng = np.random.default_rng(9)
    grid = rng.normal(size=(3, 11, 30))
    grid[:, 2, :5] = np.nan
    return Comparison(
        x_mm=_frozen(np.linspace(-1, 1, 30)),
        y_mm=_frozen(np.linspace(-2, 2, 11)),
        before_mm=_frozen(grid[0]),
        after_mm=_frozen(grid[1]),
        u_mm=_frozen(grid[2]),
        changed=_frozen(rng.random((11, 30)) > 0.5),
        change=Change(
            earlier="part µ.map.h5",
            before=_statistics(10),
            after=_statistics(11),
            difference=_statistics(12),
            spacing_mm=0.4,
            common=0.9,
            rungs=(ChangeRung("nothing", 3.0, 1.0, 0.2, 1e-300, noise=False),),
            bands=(ChangeBand("low orders", 10.0, float("inf"), 1.0, 0.1, 36.0, 0.0, significant=True),),
            false_discovery_rate=0.05,
            least_significant_um=0.6,
            share_changed=0.5,
            share_better=0.3,
            share_worse=0.2,
            rms_change_um=-1.5,
            u_rms_change_um=0.1,
            real=True,
            form_changed=True,
            worse_than_before=False,
            better_than_before=True,
            words=("RMS 5 -> 1 um", "better"),
        ),
    )


def _correction() -> Correction:
    rng = np.random.default_rng(6)
    return Correction(
        nominal=replace(_nominal(), equidistant=None, equidistant_surface=None, quality=None),
        x_mm=_frozen(np.linspace(-1, 1, 40)),
        y_mm=_frozen(np.linspace(-2, 2, 12)),
        correction_mm=_frozen(rng.normal(size=(12, 40))),
        total_correction_mm=_frozen(rng.normal(size=(12, 40))),
        commanded_z_mm=_frozen(rng.normal(size=(12, 40))),
        commanded_normal=_frozen(rng.normal(size=(12, 40, 3))),
        extended=_frozen(rng.random((12, 40)) > 0.5),
        gain=0.8,
        pass_number=2,
        predicted=_statistics(7),
        before=_statistics(8),
        worth_another_pass=False,
        reason="below the noise: 0.2 µm",
        map_digest="cd" * 32,
        applied_maps=("ef" * 32,),
        gain_rule="wiener",
        deviation_mm=_frozen(rng.normal(size=(12, 40))),
        status=frozen_array(rng.integers(0, 6, size=(12, 40)), np.uint8),
        band=CorrectionBand(
            8.0, "noise", 4.0, 8.0, 0.0, (0.01, 0.1, 0.2), (1.0, 0.6, 0.1), (8.0,), (1.0,), "over 8 mm"
        ),
        limits=CorrectionLimits(
            0.01, 1e-3, (2.0, 1.0), 0.02, 0.03, 10.0, 5, 4, 3, 2, 1, "circle", ("steep",)
        ),
        prediction=PassPrediction(
            *np.linspace(1e-3, 1e-2, 10).tolist(), ProcessTransfer((5.0, 20.0), (0.5, 0.9), 0.05, known=True)
        ),
        response=PassResponse(0.9, 0.02, 5e-3, 1e-3, 400, "as told"),
        seat=Seat(
            ((1.0, 0.0, 0.0, 5.0), (0.0, 1.0, 0.0, 6.0), (0.0, 0.0, 1.0, 7.0), (0.0, 0.0, 0.0, 1.0)),
            9,
            5e-4,
            None,
            (51.0, 31.0),
            ("rotation about z",),
            1e-4,
            (DoubtfulTouch(5, 0.05),),
        ),
        gate=GateReport(
            skipped=False,
            exports=(
                GatedExport(
                    "xyz",
                    480,
                    (
                        GateCheck("sign", passed=True, value=1.0, limit=1.0, unit="", words="as meant"),
                        GateCheck("band", passed=True, value=None, limit=None, unit="", words="not known"),
                    ),
                    0.005,
                    0.02,
                    0.001,
                    None,
                    1e-6,
                ),
            ),
        ),
    )


def assert_same(a: Any, b: Any, path: str = "noun") -> None:
    assert type(a) is type(b), path
    if isinstance(a, np.ndarray):
        assert a.dtype == b.dtype, path
        np.testing.assert_array_equal(a, b, err_msg=path)
    elif is_dataclass(a):
        for field in fields(a):
            assert_same(getattr(a, field.name), getattr(b, field.name), f"{path}.{field.name}")
    elif isinstance(a, Mapping):
        assert dict(a) == dict(b), path
    else:
        assert a == b, path


@pytest.fixture
def same() -> Callable[[Any, Any], None]:
    return assert_same


@pytest.fixture
def nominal() -> Nominal:
    return _nominal()


@pytest.fixture
def alignment() -> Alignment:
    return _alignment()


@pytest.fixture(
    params=[_nominal, _alignment, _map, _correction], ids=["nominal", "alignment", "map", "correction"]
)
def noun(request: pytest.FixtureRequest) -> Any:
    return request.param()


@pytest.fixture
def nouns() -> dict[str, Any]:
    return {"nominal": _nominal(), "alignment": _alignment(), "map": _map(), "correction": _correction()}


@pytest.fixture
def steps() -> tuple[Step, ...]:
    return (
        Step(
            "offset",
            "0.1.0",
            "2026-01-31T12:00:00Z",
            {"tip_radius_mm": 1.5},
            (InputFile("a.xyz", "ab" * 32),),
        ),
        Step("align", "0.1.0", "2026-01-31T12:01:00Z", {"distance": "smooth", "µ": [1, None]}),
    )
