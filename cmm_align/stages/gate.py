"""The gate: each exported file, read back, is ground by an ideal machine and measured again on paper.

With the points of a file over the nominal, ``off = (z - s) n_z - total`` is how far the machine is told
wrongly along the normal n. The virtual measurement finds, at the foot point of each measured point,

    e' = e + correction + off,

which is e plus the surface that stands in the file less the one that was commanded before. Asked is whether
the file covers the part and lies on the nominal (frame); whether what it changes is what was meant, slope +1,
and against e (sign); whether off goes with ``total (|n_z| - 1)``, as it does where e_n was written as dz
(Z against normal); how large it is (rounding) and how rough (ripple); whether stated normals are those of the
stated surface; whether there is anything in waves that are not to be corrected (band); and whether the RMS
falls. Tool centres are judged by where their wheel touches what is told: what is off is how deep it cuts.
No answer is taken from what the file was made from, but for the sum of the corrections along n.

What it does not know: what the machine makes of the file. That is the prediction of the pass.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cmm_align.errors import GateError
from cmm_align.model import Correction, DeviationMap, GateCheck, GatedExport
from cmm_align.numerics.grid_field import carried_on
from cmm_align.numerics.wheel import Wheel
from cmm_align.pose import Pose
from cmm_align.stages.gate_checks import (
    band_check,
    coverage_check,
    frame_check,
    normals_check,
    ripple_check,
    rms_check,
    rounding_check,
    sign_check,
    z_check,
)
from cmm_align.stages.likely_mistake import likely_mistake
from cmm_align.stages.map_grid import Places, places_of
from cmm_align.stages.map_noise import step_of
from cmm_align.stages.told_surface import Found, ToldSurface
from cmm_align.stages.wheel_contacts import touching
from cmm_align.surfaces.protocol import Array


@dataclass(frozen=True, slots=True)
class ReadBack:
    """What a file makes a machine grind, and nothing of what it was written from.

    Attributes
    ----------
    kind : str
        Of the export.
    points_mm : ndarray, shape (n, 3), mm, in the frame of the file
    normals : ndarray, shape (n, 3), or None
        As they stand in the file; None where it states none.
    surface_from_file : Pose
    accuracy_mm : float
        Largest error of points along the normal by their decimals.
    centres_mm : ndarray, shape (n, 3), mm, or None
        Tool centres, where the points were recovered from them and are no more than near.
    wheel : Wheel or None
        What the centres are of; axis in the frame of the file.
    reach_mm : float
        How far the commanded nodes may lie from a point; 0 if each must be there.
    """

    kind: str
    points_mm: Array
    normals: Array | None
    surface_from_file: Pose
    accuracy_mm: float
    centres_mm: Array | None = None
    wheel: Wheel | None = None
    reach_mm: float = 0.0


@dataclass(frozen=True, slots=True)
class ReadBackField:
    """A grid of what one pass takes off: correction along the normal at n places, mm, frame `surface`."""

    kind: str
    x_mm: Array
    y_mm: Array
    correction_mm: Array
    accuracy_mm: float


class Gate:
    """What the files of a compensation are judged by: the measured points and what was meant.

    Attributes
    ----------
    correction : Correction
    told : ToldSurface
        The sum of all corrections.
    points : Places
        Of the measurement, where the correction is known.
    meant_mm : ndarray, shape (n,), mm
        The correction of this pass at them.
    other_frames : dict of str to Pose
        What to call a file in a wrong frame, and what ``surface_from_file`` would then be.
    """

    def __init__(self, deviation_map: DeviationMap, correction: Correction) -> None:
        """Take the points that the correction covers."""
        points = places_of(deviation_map.alignment)
        self.correction, self.told = correction, ToldSurface(correction)
        # Two nodes past the border: points between them and the last ones inside are measured again too.
        meant = self.told.at(carried_on(correction.correction_mm, 2), points.x_mm, points.y_mm)
        known = np.isfinite(meant)
        self.points = Places(
            points.x_mm[known], points.y_mm[known], points.deviation_mm[known], points.rows[known]
        )
        self.meant_mm = meant[known]
        # The band of what was meant, for files that say that.
        self._band = band_check(self.told, correction, np.zeros_like(correction.correction_mm))
        part_from_cmm = deviation_map.alignment.part_from_machine
        surface = correction.nominal.surface_from_part
        self.other_frames = {
            "the frame of the part": _chained(surface),
            "the frame of the CMM in place of that of the part": _chained(surface, part_from_cmm),
            "a pose of the CMM applied the wrong way round": _chained(surface, part_from_cmm.inverse()),
            "the frame of the projection": Pose.identity("surface", "file"),
        }

    def judge(self, read: ReadBack | ReadBackField) -> GatedExport:
        """Return what a file is found to be.

        Parameters
        ----------
        read : ReadBack or ReadBackField
        """
        if isinstance(read, ReadBackField):
            told = ToldSurface(self.correction, self.told.jet, self.correction.correction_mm)
            found = told.found_field(read.x_mm, read.y_mm, read.correction_mm)
            # Its pixels need not be the nodes: one lies within a mesh of each.
            mesh = float(np.hypot(step_of(told.x_mm), step_of(told.y_mm)))
            checks, rms, pv = self._asked(told, found, read.accuracy_mm, mesh)
            return self._answer(read, told, found, checks, (rms, pv))
        points, pose = read.points_mm, read.surface_from_file
        if read.centres_mm is not None and read.wheel is not None:
            found = self.told.found(touching(self.told, points, read.centres_mm, read.wheel, pose))
        else:
            found = self.told.found(pose.apply(points))
        checks, rms, pv = self._asked(self.told, found, read.accuracy_mm, read.reach_mm)
        if read.normals is not None and read.centres_mm is None:
            normals = pose.rotate(read.normals)
            checks.append(normals_check(self.told, found, normals, self.correction.nominal.side))
        return self._answer(read, self.told, found, checks, (rms, pv))

    def _asked(
        self, told: ToldSurface, found: Found, accuracy_mm: float, reach_mm: float
    ) -> tuple[list[GateCheck], float | None, float | None]:
        """Return the checks that all files go through, and RMS and PV measured again."""
        coverage, off_grid = coverage_check(told, found, reach_mm)
        checks = [coverage, frame_check(told, found, accuracy_mm)]
        if off_grid is None:
            return checks, None, None
        before = self.points.deviation_mm
        change = self.meant_mm + told.roughly_at(off_grid, self.points.x_mm, self.points.y_mm)
        after = before + change
        z, explained_mm = z_check(told, found, accuracy_mm)
        rounding = rounding_check(found, explained_mm)
        checks += [
            sign_check(change, self.meant_mm, before, accuracy_mm),
            z,
            rounding,
            ripple_check(found, explained_mm),
            self._band if rounding.passed else band_check(told, self.correction, off_grid),
            rms_check(before, change, accuracy_mm),
        ]
        return checks, float(np.sqrt(np.mean(after**2))), float(np.ptp(after))

    def _answer(
        self,
        read: ReadBack | ReadBackField,
        told: ToldSurface,
        found: Found,
        checks: list[GateCheck],
        after: tuple[float | None, float | None],
    ) -> GatedExport:
        """Return the answer for a file, with the likely mistake where there is one."""
        words = ""
        if not all(check.passed for check in checks):
            points, pose = (
                (read.points_mm, read.surface_from_file)
                if isinstance(read, ReadBack)
                else (None, Pose.identity("surface", "surface"))
            )
            now = self.correction.correction_mm
            words = likely_mistake(told, found, points, pose, self.other_frames, now)
        e = self.points.deviation_mm
        return GatedExport(
            kind=read.kind,
            n=len(found.x_mm),
            checks=tuple(checks),
            rms_before_mm=float(np.sqrt(np.mean(e**2))),
            pv_before_mm=float(np.ptp(e)),
            rms_mm=after[0],
            pv_mm=after[1],
            accuracy_mm=read.accuracy_mm,
            looks_like=words,
        )


def refuse(found: GatedExport, where: str) -> None:
    """Refuse a file that did not pass.

    Raises
    ------
    GateError
        With the check that failed first, what the file looks like, and what to do.
    """
    failed = [check for check in found.checks if not check.passed]
    if not failed:
        return
    others = ", ".join(check.name for check in failed[1:])
    raise GateError(
        f"the gate holds this file back: {failed[0].name}: {failed[0].words}"
        + (f" (and {others})" if others else "")
        + (f"; it looks like {found.looks_like}" if found.looks_like else ""),
        where=where,
        expected="a file that makes the part better, read back from the disk",
        remedy="nothing was written: do not grind; check post, frame and sign, and compensate again",
    )


def _chained(surface_from_part: Pose, part_from_file: Pose | None = None) -> Pose:
    """Return ``surface_from_file`` of a file in a frame that the part is posed in."""
    if part_from_file is None:
        return Pose(surface_from_part.rotation, surface_from_part.translation_mm, "surface", "file")
    turned = Pose(part_from_file.rotation, part_from_file.translation_mm, surface_from_part.source, "file")
    return surface_from_part @ turned
