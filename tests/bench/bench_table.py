"""Tables of what was measured, on a named machine and day: as CSV, as Markdown, and in README.md.

A table of the README stands between ``<!-- bench NAME -->`` and ``<!-- end NAME -->``; nobody writes there by
hand. Its format is its headings and its first two columns with every number taken out, and the lines above
and below it: small runs and large ones differ in numbers alone, so that a small run tells whether the table
still is what the script writes.
"""

from __future__ import annotations

import csv
import os
import platform
import re
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

README = Path(__file__).resolve().parents[2] / "README.md"
MISSED = "**missed**"


@dataclass(frozen=True)
class Line:
    """One number beside its bar; `met` is None where there is no bar, or nothing to hold against it."""

    what: str
    bar: str
    measured: str
    met: bool | None = None


@dataclass(frozen=True)
class Table:
    """Lines with their headings, the commands that made them, and what to know about them.

    `words` are the headings of label, bar and figure.
    """

    name: str
    words: tuple[str, str, str]
    lines: tuple[Line, ...]
    command: str
    notes: tuple[str, ...] = ()

    def cells(self) -> list[tuple[str, str, str]]:
        """Return headings and lines; a bar that was missed says so."""
        rows = [
            (line.what, line.bar or "–", line.measured + (f" {MISSED}" if line.met is False else ""))
            for line in self.lines
        ]
        return [self.words, *rows]


def short(n: float) -> str:
    """Write a number of points: 5000, 1.2e6."""
    if n < 10_000:
        return f"{n:.0f}"
    mantissa, exponent = f"{n:.1e}".split("e")
    return f"{mantissa.removesuffix('.0')}e{int(exponent)}"


def met(value: float, bar: float) -> bool:
    """Return whether a value keeps an upper bar; one that is no number does not."""
    return bool(value <= bar)


def machine() -> str:
    """Name the machine: processor, cores, memory, interpreter; no name of a host or a person."""
    name = platform.processor() or platform.machine()
    told = Path("/proc/cpuinfo")
    if told.exists():
        found = re.search(r"model name\s*:\s*(.+)", told.read_text(encoding="utf-8"))
        name = found.group(1).strip() if found else name
    memory = ""
    if hasattr(os, "sysconf") and "SC_PHYS_PAGES" in os.sysconf_names:
        gib = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 2**30
        memory = f", {gib:.0f} GiB"
    python = f"Python {platform.python_version()}, NumPy {np.__version__}"
    return f"{name}, {os.cpu_count()} cores{memory}, {platform.system()}, {python}"


def today() -> str:
    """Return the day, UTC."""
    return datetime.now(UTC).date().isoformat()


def origin(table: Table) -> str:
    """Say where, when and how a table was made."""
    return f"Measured {today()} by `{table.command}` on {machine()}."


def markdown(table: Table) -> str:
    """Return a table as Markdown, its origin under it."""
    head, *rows = (tuple(cell.replace("|", "\\|") for cell in row) for row in table.cells())
    lines = [f"| {' | '.join(head)} |", "|---|---|---|", *(f"| {' | '.join(row)} |" for row in rows)]
    return "\n".join([*lines, "", " ".join([origin(table), *table.notes])])


def write_csv(path: Path, head: tuple[str, ...], rows: list[tuple[object, ...]]) -> None:
    """Write a table of numbers; every column says its unit."""
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(head)
        writer.writerows([f"{cell:.9g}" if isinstance(cell, float) else cell for cell in row] for row in rows)


def format_of(table: Table) -> list[tuple[str, ...]]:
    """Return headings, labels and bars with all numbers taken out."""
    head, *rows = table.cells()
    return [head, *(tuple(without_numbers(cell) for cell in row[:2]) for row in rows)]


def without_numbers(text: str) -> str:
    """Return a text with ``#`` for each number."""
    return re.sub(r"\d[\d\u2009.,]*(e[+-]?\d+)?", "#", text)


def marked(name: str) -> re.Pattern[str]:
    """Return what finds the place of a table in the README."""
    return re.compile(rf"(<!-- bench {name} -->\n)(.*?)(<!-- end {name} -->)", re.DOTALL)


def put_into_readme(tables: list[Table]) -> None:
    """Write tables into README.md, each between its marks."""
    text = README.read_text(encoding="utf-8")
    for table in tables:
        text, n = marked(table.name).subn(lambda m, t=table: m[1] + markdown(t) + "\n" + m[3], text)
        if n != 1:
            raise SystemExit(f"README.md: {n} places for the table {table.name!r}, expected 1")
    README.write_text(text, encoding="utf-8")


def faults_of_readme(tables: list[Table], text: str | None = None) -> list[str]:
    """Return what of the README's tables is not what the scripts write; nothing if all fits."""
    text = README.read_text(encoding="utf-8") if text is None else text
    faults = []
    for table in tables:
        found = marked(table.name).search(text)
        if found is None:
            faults.append(f"no place for the table {table.name!r}")
            continue
        there = rows_of(found[2])
        here = format_of(table)
        if [there[0], *(tuple(map(without_numbers, row[:2])) for row in there[1:])] != here:
            faults.append(f"the table {table.name!r} is not what its script writes")
        if not re.search(r"^Measured \d{4}-\d\d-\d\d by `python .*` on .+ cores", found[2], re.MULTILINE):
            faults.append(f"the table {table.name!r} does not say when, how and on what it was measured")
    return faults


def rows_of(text: str) -> list[tuple[str, ...]]:
    """Return the cells of a Markdown table, its rule left out."""
    lines = [line for line in text.splitlines() if line.startswith("|") and not line.startswith("|---")]
    return [tuple(cell.strip() for cell in line.strip("|").split(" | ")) for line in lines] or [()]
