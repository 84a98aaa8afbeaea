"""What lines through a part are called."""

from __future__ import annotations

from cmm_align.report.section_lines import middle_lines
from cmm_align.surfaces.protocol import Bounds


def test_the_middle_of_a_part_is_named_without_rounding_errors() -> None:
    bounds = Bounds(-51.0, 51.0 - 1e-14, -31.000000000000007, 31.0)

    assert [line.name for line in middle_lines(bounds)] == ["x = 0 mm", "y = 0 mm"]
