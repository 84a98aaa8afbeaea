"""How fast lines become points: ``python tests/bench/wire_speed.py``; processor time of one core."""

from __future__ import annotations

import sys
from pathlib import Path

from table import Row, Stopwatch, show

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from dialects.streams import WRITERS, stream_of

from cmm_align.dialects import decoded, points_of

STEPS = 225
"""Points along each side: 50 625 points."""
CHUNK = 4096
LINES = 150_000


def main() -> None:
    """Print seconds for 150 000 lines of each machine profile."""
    rows = []
    for name in WRITERS:
        profile, raw, truth = stream_of(name, STEPS)
        pieces = [raw[at : at + CHUNK] for at in range(0, len(raw), CHUNK)]
        best_s = float("inf")
        for _ in range(3):
            with Stopwatch() as watch:
                points, rejected, _ = points_of(decoded(pieces, profile), name, profile)
            best_s = min(best_s, watch.cpu)
        if len(points) != len(truth) or rejected:
            raise SystemExit(f"{name}: {len(points)} of {len(truth)} points")
        lines = raw.count(b"\r")
        measured = f"{best_s * LINES / lines:.2f} s ({len(points)} points in {lines} lines)"
        rows.append(Row(name, "about 1 s", measured))
    show(f"{LINES} lines to points", rows)


if __name__ == "__main__":
    main()
