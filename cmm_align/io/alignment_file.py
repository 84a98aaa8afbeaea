"""The file of an alignment, written by `align`; the file of a map carries the same on."""

from __future__ import annotations

import numpy as np

from cmm_align.io.hdf5_library import h5py
from cmm_align.io.records import read_record, write_record
from cmm_align.io.safe_hdf5 import find, is_older, read_array
from cmm_align.io.surface_group import CARRIED, read_nominal_group, read_pose, write_nominal_group, write_pose
from cmm_align.io.writing import write_array
from cmm_align.model import Alignment, FitReport, frozen_array


def write_body(file: h5py.File, alignment: Alignment) -> None:
    """Fill a file with an alignment; of its nominal only the surface and its numbers are kept."""
    write_nominal_group(file.create_group(CARRIED), alignment.nominal)
    pose = file.create_group("pose")
    write_pose(pose, "part_from_machine", alignment.part_from_machine)
    write_array(pose, "covariance", alignment.covariance)
    points = file.create_group("points")
    write_array(points, "tip_centre_machine_mm", alignment.tip_centre_machine_mm)
    write_array(points, "tip_centre_part_mm", alignment.tip_centre_part_mm)
    write_array(points, "contact_part_mm", alignment.contact_part_mm)
    write_array(points, "normal", alignment.normals)
    write_array(points, "deviation_mm", alignment.deviation_mm)
    write_array(points, "used", alignment.used)
    write_array(points, "judged", alignment.judged)
    write_array(points, "status", alignment.status)
    if alignment.sigma_mm is not None:
        write_array(points, "sigma_mm", alignment.sigma_mm)
    write_array(points, "id", alignment.ids)
    write_record(file.create_group("report"), alignment.report)


def read_body(file: h5py.File) -> Alignment:
    """Return the alignment of a file.

    Raises
    ------
    MalformedInputError
        If something is missing or not as expected.
    """
    machine = read_array(file, "/points/tip_centre_machine_mm", (None, 3), finite=True)
    n = len(machine)
    used = read_array(file, "/points/used", (n,), "b")
    judged, status = used, (~used).astype("uint8")  # as files of older versions meant it
    if not is_older(file):
        judged = read_array(file, "/points/judged", (n,), "b")
        status = read_array(file, "/points/status", (n,), "i").astype("uint8")
    has_sigma = find(file, "/points/sigma_mm") is not None
    return Alignment(
        nominal=read_nominal_group(file, CARRIED),
        part_from_machine=read_pose(file, "/pose/part_from_machine"),
        covariance=read_array(file, "/pose/covariance", (6, 6)),
        tip_centre_machine_mm=machine,
        tip_centre_part_mm=read_array(file, "/points/tip_centre_part_mm", (n, 3), finite=True),
        contact_part_mm=read_array(file, "/points/contact_part_mm", (n, 3)),
        normals=read_array(file, "/points/normal", (n, 3)),
        deviation_mm=read_array(file, "/points/deviation_mm", (n,)),
        used=used,
        judged=judged,
        status=frozen_array(status, np.uint8),
        ids=read_array(file, "/points/id", (n,), "i"),
        report=read_record(file, "/report", FitReport),
        sigma_mm=read_array(file, "/points/sigma_mm", (n,)) if has_sigma else None,
    )
