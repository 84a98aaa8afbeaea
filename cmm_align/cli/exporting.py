"""Wheel and exports of `compensate`: their options, their checks, their rows in the report."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from cmm_align.cli.options import FILE, Length
from cmm_align.config import EXPORTS, RASTERS, SPIRALS, CompensateConfig, ExportConfig, checked
from cmm_align.errors import UsageError
from cmm_align.units import DEG_PER_RAD, UM_PER_MM, URAD_PER_RAD

if TYPE_CHECKING:
    from cmm_align.model import Correction
    from cmm_align.posts import Prepared, Template
    from cmm_align.stages.wheel_check import DepthCheck, WheelCheck

HEADINGS: Final = {
    "Wheel": ("--wheel-radius", "--wheel-tip-radius", "--wheel-axis", "--depth-of-cut"),
    "Exports": (
        "--export",
        "--post",
        "--text-decimals",
        "--line-spacing",
        "--point-spacing",
        "--raster-along",
        "--spiral-direction",
        "--feed",
        "--safe-height",
        "--footprint-radius",
    ),
}
"""What the options stand under in the help."""

_MRAD_PER_RAD: Final = URAD_PER_RAD / 1000

_OPTIONS: Final = (
    click.option("--wheel-radius", type=Length(), metavar="L", help="Largest radius of the wheel."),
    click.option(
        "--wheel-tip-radius", type=Length(), metavar="L", help="Radius of the rounded rim: a toroidal wheel."
    ),
    click.option(
        "--wheel-axis",
        metavar="A",
        help="Axis of a toroidal wheel: x, y, z or 0,0.6,0.8, frame of the exports.",
    ),
    click.option("--depth-of-cut", type=Length(), metavar="L", help="Most that the pass takes off, as 30um."),
    click.option(
        "--export", "exports", type=click.Choice(EXPORTS), multiple=True, help="Repeatable.  [default: xyz]"
    ),
    click.option("--post", type=FILE, metavar="FILE.toml", help="Format of --export template."),
    click.option(
        "--text-decimals", type=click.IntRange(6, 12), help="Decimals of lengths in texts, mm.  [default: 6]"
    ),
    click.option("--line-spacing", type=Length(), metavar="L", help="Most between the lines of a tool path."),
    click.option("--point-spacing", type=Length(), metavar="L", help="Most between its points."),
    click.option("--raster-along", type=click.Choice(RASTERS), help="Lines of a raster.  [default: x]"),
    click.option("--spiral-direction", type=click.Choice(SPIRALS), help="[default: inwards]"),
    click.option("--feed", type=float, metavar="F", help="Feed of the tool centre, mm/min.  [default: 200]"),
    click.option("--safe-height", type=Length(), metavar="L", help="Of rapid moves.  [default: 10]"),
    click.option("--footprint-radius", type=Length(), metavar="L", help="Of the tool: --export dwell."),
)


def exporting_options(callback: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options of wheel and exports to a command, which takes them together as keywords."""
    for option in reversed(_OPTIONS):
        callback = option(callback)
    return callback


def with_options(
    config: CompensateConfig, export: ExportConfig, values: dict[str, Any]
) -> tuple[CompensateConfig, ExportConfig]:
    """Return the settings with the options that were given put over them.

    Raises
    ------
    UsageError
        If a number is outside its limits.
    """

    def given(**names: str) -> dict[str, Any]:
        return {key: values[name] for key, name in names.items() if values[name] is not None}

    depth = values["depth_of_cut"]
    config = replace(
        config,
        **given(
            wheel_radius_mm="wheel_radius",
            wheel_tip_radius_mm="wheel_tip_radius",
            wheel_axis="wheel_axis",
            text_decimals="text_decimals",
        ),
        depth_of_cut_um=config.depth_of_cut_um if depth is None else depth * UM_PER_MM,
    )
    post, exports = values["post"], values["exports"]
    export = replace(
        export,
        **given(
            line_spacing_mm="line_spacing",
            point_spacing_mm="point_spacing",
            raster_along="raster_along",
            spiral_direction="spiral_direction",
            feed_mm_min="feed",
            safe_height_mm="safe_height",
            footprint_radius_mm="footprint_radius",
        ),
        post=export.post if post is None else str(post),
        formats=",".join(exports) or export.formats,
    )
    return checked(config), checked(export)


@dataclass(frozen=True, slots=True)
class Plan:
    """Which exports are written, where."""

    names: tuple[str, ...]
    paths: tuple[Path, ...]
    config: ExportConfig
    post: Template | None


def plan_of(config: ExportConfig, output: Path) -> Plan:
    """Return what is to be written beside an output.

    Raises
    ------
    UsageError
        If an export is not known or named twice, or a template and its description do not come together.
    MalformedInputError
        If the description of a format is wrong.
    """
    from cmm_align import posts

    names = tuple(name.strip() for name in config.formats.split(",") if name.strip())
    if not names or len(set(names)) < len(names):
        raise UsageError(f"exports {config.formats!r}", expected=f"some of {', '.join(EXPORTS)}, each once")
    if bool(config.post) != ("template" in names):
        raise UsageError("--export template and --post FILE.toml go together")
    post = posts.read_template(config.post) if config.post else None
    paths = tuple(output.with_suffix(posts.suffix_of(name, post)) for name in names)
    return Plan(names, paths, config, post)


def checked_wheel(
    correction: Correction, config: CompensateConfig
) -> tuple[WheelCheck | None, DepthCheck | None]:
    """Return what was found of wheel and depth of cut, each None if it is not known.

    Raises
    ------
    InputError
        If the wheel gouges, or runs in air.
    """
    from cmm_align.stages.wheel_check import check_depth, check_wheel, refuse_gouge, wheel_of

    wheel, depth = wheel_of(config), check_depth(correction, config)
    found = None if wheel is None else check_wheel(correction, wheel)
    if found is not None:
        refuse_gouge(found)
    return found, depth


def prepared(
    plan: Plan, correction: Correction, config: CompensateConfig, name: str
) -> list[tuple[Path, Prepared]]:
    """Return the exports, all checked before the first of them is written."""
    from cmm_align import posts
    from cmm_align.stages.wheel_check import wheel_of

    job = posts.ExportJob(correction, plan.config, config.text_decimals, wheel_of(config), name)
    return [
        (path, posts.prepared(export, job, plan.post))
        for export, path in zip(plan.names, plan.paths, strict=True)
    ]


def rows(wheel: WheelCheck | None, depth: DepthCheck | None, paths: Sequence[Path]) -> list[tuple[str, str]]:
    """Return what the report says of wheel and exports."""
    found = []
    if wheel is not None:
        x, y = wheel.fill_at_mm
        found.append(("wheel", wheel.wheel.words))
        if wheel.fill > 0.0:
            found.append(
                ("", f"the surface is concave by {100.0 * wheel.fill:.0f} % of it at ({x:.2f}, {y:.2f}) mm")
            )
        x, y = wheel.slope_change_at_mm
        found.append(
            (
                "",
                f"slopes change by up to {wheel.slope_change_rad * _MRAD_PER_RAD:.2f} mrad at "
                f"({x:.2f}, {y:.2f}) mm; with the old normals the path would cut "
                f"{wheel.old_normals_mm * UM_PER_MM:.3f} um too deep",
            )
        )
    if depth is not None:
        found.append(
            (
                "depth of cut",
                f"{depth.depth_mm * UM_PER_MM:g} um, at least {depth.least_mm * UM_PER_MM:.2f} um everywhere",
            )
        )
    return [*found, ("for the machine", ", ".join(path.name for path in paths))]


def warnings(wheel: WheelCheck | None) -> list[str]:
    """Return what to know about the wheel."""
    from cmm_align.stages.wheel_check import FILL_WARNING

    if wheel is None or wheel.fill <= FILL_WARNING:
        return []
    x, y = wheel.fill_at_mm
    return [
        f"the wheel hardly fits: the corrected surface has {100.0 * wheel.fill:.0f} % of its curvature at "
        f"({x:.3f}, {y:.3f}) mm; a smaller wheel or a longer low pass is safer"
    ]


def result(wheel: WheelCheck | None, depth: DepthCheck | None) -> dict[str, Any]:
    """Return the part of the result of `compensate` that tells of the wheel."""
    return {
        "wheel": None
        if wheel is None
        else {
            "radius_mm": wheel.wheel.radius_mm,
            "tip_radius_mm": wheel.wheel.tip_radius_mm,
            "axis": list(wheel.wheel.axis),
            "curvature_share": wheel.fill,
            "curvature_share_at_mm": list(wheel.fill_at_mm),
            "overcut_um": wheel.overcut_mm * UM_PER_MM,
            "slope_change_mrad": wheel.slope_change_rad * _MRAD_PER_RAD,
            "slope_change_deg": wheel.slope_change_rad * DEG_PER_RAD,
            "slope_change_at_mm": list(wheel.slope_change_at_mm),
            "old_normals_um": wheel.old_normals_mm * UM_PER_MM,
        },
        "depth_of_cut_um": None if depth is None else depth.depth_mm * UM_PER_MM,
        "least_depth_um": None if depth is None else depth.least_mm * UM_PER_MM,
        "correction_range_um": None if depth is None else depth.range_mm * UM_PER_MM,
    }
