"""Streams as machines would send them: one saddle, written for every profile in configs/machines."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from decimal import Decimal
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cmm_align.dialects import Event, Hit, MachineProfile, Note, Rejected, decoded, read_profile

MACHINES = Path(__file__).resolve().parents[2] / "configs" / "machines"
TIP_RADIUS_MM = 1.5


def saddle_tip_centres_mm(steps: int = 5) -> np.ndarray:
    """Return tip centres (N, 3) over z = 0.004 x^2 - 0.002 y^2 + 1e-4 x^2 y, and the normals beside them."""
    x, y = (part.ravel() for part in np.meshgrid(np.linspace(-10, 10, steps), np.linspace(-10, 10, steps)))
    slope = np.stack([0.008 * x + 2e-4 * x * y, -0.004 * y + 1e-4 * x * x], axis=1)
    normals = np.column_stack([-slope, np.ones_like(x)]) / np.sqrt(1.0 + (slope**2).sum(axis=1))[:, None]
    surface = np.column_stack([x, y, 0.004 * x * x - 0.002 * y * y + 1e-4 * x * x * y])
    return np.hstack([surface + TIP_RADIUS_MM * normals, normals])


class Stream(NamedTuple):
    """What a machine sends, and what it means."""

    profile: MachineProfile
    raw: bytes
    truth_mm: list[tuple[float, float, float]]
    """As printed: the doubles nearest to the decimals."""


def stream_of(name: str, steps: int = 5) -> Stream:
    """Return the stream for a profile by the name of its file."""
    profile = read_profile(MACHINES / f"{name}.toml")
    decimals, write = WRITERS[name]
    unit_mm = Decimal("25.4") if profile.units == "inch" else Decimal(1)
    printed = [
        tuple(f"{Decimal(float(v)) / unit_mm:.{decimals}f}" for v in row[:3])
        for row in saddle_tip_centres_mm(steps)
    ]
    normals = saddle_tip_centres_mm(steps)[:, 3:]
    truth = [tuple(float(Decimal(text) * unit_mm) for text in row) for row in printed]
    return Stream(profile, write(printed, normals).encode("ascii"), truth)


def _counts(text: str) -> str:
    return str(int(Decimal(text).scaleb(3)))


def _ptmeas(rows: Iterable[tuple[str, ...]], normals: np.ndarray) -> str:
    text = ""
    for tag, ((x, y, z), n) in enumerate(zip(rows, normals, strict=True), start=10):
        ijk = ",".join(f"{value:.5f}" for value in n)
        text += f"{tag:05d} &\r\nE0001 # X({x}), Y({y}), Z(40.2)\r\n"
        text += f"{tag:05d} # ER(1.50000), IJK({ijk}), X({x}), Y({y}), Z({z})\r\n{tag:05d} %\r\n"
    return text


def _sorted_scan(rows: Iterable[tuple[str, ...]], _: np.ndarray) -> str:
    rows = list(rows)
    blocks = [rows[first : first + 4] for first in range(0, len(rows), 4)]
    lines = ["00017 # " + ", ".join(f"0,{','.join(row)}" for row in block) for block in blocks]
    return "\r\n".join(["00017 &", *lines, "00017 %", ""])


WRITERS: dict[str, tuple[int, Callable[..., str]]] = {
    "generic_xyz": (3, lambda rows, _: "".join(f"{','.join(row)}\r\n" for row in rows)),
    "generic_counts": (3, lambda rows, _: "".join(f"{','.join(map(_counts, row))}\r\n" for row in rows)),
    "generic_letters": (3, lambda rows, _: "".join(f"X{x},Y{y},Z{z}\r\n" for x, y, z in rows)),
    "generic_letters_counts_rotary": (
        3,
        lambda rows, _: "".join(f"X{_counts(x)},Y{_counts(y)},Z{_counts(z)},W2455\r" for x, y, z in rows),
    ),
    "gmserver": (
        6,
        lambda rows, normals: "".join(
            f"\n ( {x} {y} {z} 0.000000 {n[0]:f} {n[1]:f} {n[2]:f} ) HIT\r"
            for (x, y, z), n in zip(rows, normals, strict=True)
        ),
    ),
    "ipp_tap": (5, _ptmeas),
    "ipp_scan_sorted": (5, _sorted_scan),
    "manual_readout_7e1_inch": (
        5,
        lambda rows, _: "".join("  ".join(f"{Decimal(v):+}" for v in row) + "\r" for row in rows),
    ),
    "printed_table_de": (
        3,
        lambda rows, _: (
            "Nr;X;Y;Z\r\n"
            + "".join(f"{k};{';'.join(row)}\r\n".replace(".", ",") for k, row in enumerate(rows, start=1))
            + "ENDE\r\n"
        ),
    ),
}


class Seen(NamedTuple):
    """Events by kind."""

    points_mm: list[tuple[float, float, float]]
    rejected: list[Rejected]
    notes: list[Note]


def sorted_out(events: Iterable[Event]) -> Seen:
    """Return events by kind."""
    seen = Seen([], [], [])
    for event in events:
        if isinstance(event, Hit):
            seen.points_mm.append(event[:3])
        elif isinstance(event, Rejected):
            seen.rejected.append(event)
        else:
            seen.notes.append(event)
    return seen


def read(raw: bytes, profile: MachineProfile, size: int | None = None) -> Seen:
    """Return what a stream says, fed in pieces of `size` bytes."""
    pieces = [raw] if size is None else [raw[at : at + size] for at in range(0, len(raw), size)]
    return sorted_out(decoded(pieces, profile))
