"""The earlier measurement of `error-map --compare`: read, compared, told."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cmm_align.cli.job import Job, beside
from cmm_align.config import ErrorMapConfig
from cmm_align.errors import UsageError
from cmm_align.model import Change, DeviationMap
from cmm_align.report.wording import as_length, as_percent, at_place, extreme, in_um
from cmm_align.units import UM_PER_MM

if TYPE_CHECKING:
    from cmm_align.cli.drawing import Drawings
    from cmm_align.model import Alignment
    from cmm_align.report.wishes import Wishes


def check_earlier(job: Job, aligned: Path, earlier: Path, config: ErrorMapConfig) -> None:
    """Refuse, before anything is computed, an earlier measurement that is none, and a filtered comparison.

    Raises
    ------
    UsageError
        If both are one file, or a cutoff was asked for.
    InputError
        If the file is neither a map nor an alignment.
    """
    from cmm_align.cli import opening
    from cmm_align.io.schema import MAP

    opening.check_stage(earlier, MAP, "--compare", job.units)
    if aligned.samefile(earlier):
        raise UsageError(
            f"--compare {earlier}: that is the measurement itself",
            expected="the map or the alignment of an earlier one",
        )
    if config.low_pass_mm or config.high_pass_mm:
        raise UsageError(
            "--compare with a cutoff",
            expected="a map with all waves: the comparison tells long, middle and fine ones apart itself",
            remedy="leave the cutoffs out",
        )


def read_earlier(earlier: Path) -> tuple[Alignment, list[str]]:
    """Return the measurement behind a map or an alignment, and what to know about it."""
    from cmm_align import io
    from cmm_align.io.schema import ALIGNMENT

    if io.schema_of(earlier) == ALIGNMENT:
        return io.read_alignment(earlier), []
    found = io.read_map(earlier)
    if found.filter is None:
        return found.alignment, []
    return found.alignment, [
        f"{earlier.name} is a filtered map ({found.filter.words}): compared are its points, unfiltered"
    ]


def compared(
    deviation_map: DeviationMap, earlier: Path, config: ErrorMapConfig, aligned: Path
) -> tuple[DeviationMap, list[str]]:
    """Return the map with what changed since an earlier measurement, and what to know about that.

    Parameters
    ----------
    deviation_map : DeviationMap
    earlier : Path
        A map or an alignment.
    config : ErrorMapConfig
        With which the map was made.
    aligned : Path
        The measurement behind the map.
    """
    from dataclasses import replace

    from cmm_align.stages.comparison import compare

    before, warnings = read_earlier(earlier)
    comparison = compare(deviation_map, before, config, names=(str(aligned), str(earlier)))
    return replace(deviation_map, comparison=comparison), [
        *warnings,
        *_cautions(deviation_map, comparison.change),
    ]


def files(drawings: Drawings, output: Path) -> list[Path]:
    """Return where the pictures of a comparison go, beside the map; none where no picture is wanted."""
    return [beside(output, f".compare.{kind}") for kind in drawings.formats if drawings.names]


def draw_all(
    deviation_map: DeviationMap, paths: Sequence[Path], wishes: Wishes, *, overwrite: bool
) -> tuple[list[Path], list[str]]:
    """Draw what changed; return the pictures that were written, and a sentence for those that were not.

    Parameters
    ----------
    deviation_map : DeviationMap
        With its comparison.
    paths : sequence of Path
        From `files`.
    wishes : Wishes
    overwrite : bool
        Whether pictures that are there may be replaced.
    """
    from cmm_align.cli.drawing import attempt, named, not_drawn

    def draw(place: Path) -> None:
        from cmm_align.report.comparison_picture import draw_comparison

        draw_comparison(deviation_map, place, f"{wishes.title}: what changed", wishes.source)

    drawn, faults = [], []
    for path in paths:
        fault = attempt(draw, path, overwrite=overwrite)
        if fault:
            faults.append(not_drawn([named(path)], fault))
        else:
            drawn.append(path)
    return drawn, faults


def of_change(change: Change | None) -> dict[str, Any]:
    """Return what a comparison adds to the result of `error-map`; nothing without one."""
    if change is None:
        return {}
    from cmm_align.cli.results import of_statistics

    plain = asdict(change)
    for name in ("before", "after", "difference"):
        plain[name] = of_statistics(getattr(change, name))
    for name in ("common", "share_changed", "share_better", "share_worse", "false_discovery_rate"):
        plain[f"{name}_percent"] = 100.0 * plain.pop(name)
    return {"compare": plain}


def rows_of_change(change: Change | None) -> list[tuple[str, str]]:
    """Return the rows of the summary that tell what changed; none without a comparison."""
    if change is None:
        return []
    before, after, d = change.before, change.after, change.difference
    return [
        ("compared", f"with {change.earlier}, {as_percent(change.common)} of the map in common"),
        ("before", f"PV {in_um(before.pv_mm)}, RMS {in_um(before.rms_mm)}   (over {before.n} common nodes)"),
        ("after", f"PV {in_um(after.pv_mm)}, RMS {in_um(after.rms_mm)}"),
        (
            "difference",
            f"PV {in_um(d.pv_mm)}, RMS {in_um(d.rms_mm)}; {extreme(d.min_mm)} at {at_place(d.min_at_mm)}, "
            f"{extreme(d.max_mm)} at {at_place(d.max_at_mm)}",
        ),
        ("change", "; ".join(change.words)),
    ]


def details_of_change(change: Change | None) -> list[tuple[str, str]]:
    """Return what there is to say of a change beyond its summary; nothing without a comparison."""
    if change is None:
        return []
    ladder = [
        (
            "difference" if rung.removed == "nothing" else f"... without {rung.removed}",
            f"RMS {in_um(rung.rms_um / UM_PER_MM)}, noise{' and poses give' if k == 0 else ' gives'} "
            f"{in_um(rung.expected_rms_um / UM_PER_MM)}: {'noise' if rung.noise else 'changed'}",
        )
        for k, rung in enumerate(change.rungs)
    ]
    bands = [
        (
            band.name,
            f"waves from {band.shortest_mm:.3g} mm on: RMS {in_um(band.rms_um / UM_PER_MM)}, noise gives "
            f"{in_um(band.expected_rms_um / UM_PER_MM)}: {'changed' if band.significant else 'noise'}",
        )
        for band in change.bands
    ]
    return [*ladder, *bands, ("common grid", as_length(change.spacing_mm))]


def _cautions(deviation_map: DeviationMap, change: Change) -> list[str]:
    """Return what to know about a comparison."""
    texts = []
    if change.worse_than_before:
        texts.append(
            f"the part is WORSE than before, outside the noise: RMS {in_um(change.before.rms_mm)} -> "
            f"{in_um(change.after.rms_mm)} (u of the change {change.u_rms_change_um:.2g} um)"
        )
    if change.spacing_mm > 1.01 * deviation_map.spacing_mm:
        texts.append(
            f"compared on a grid of {as_length(change.spacing_mm)}: the earlier measurement carries no more"
        )
    return texts
