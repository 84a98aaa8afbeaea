"""What a control takes, and a refusal that names the setting that would help."""

from __future__ import annotations

from cmm_align.config import ExportConfig
from cmm_align.errors import UsageError


def check_lines(count: int, config: ExportConfig) -> None:
    """Refuse a program of more lines than the control takes.

    Raises
    ------
    UsageError
        With the number of lines.
    """
    if 0 < config.max_lines < count:
        raise UsageError(
            f"a program of {count} lines",
            expected=f"at most {config.max_lines} (max_lines)",
            remedy="take a larger line_spacing_mm or point_spacing_mm, or a map with a larger --spacing",
        )
