"""The README's tables of measured numbers: ``python tests/bench/readme_tables.py [NAME ...]``.

    [--small] [--check]

Runs the benches (paper, peers, scaling; all unless named) and writes their tables between the marks of
README.md, with day, command and machine. ``--check`` writes nothing: it compares the format of what is
there with what the benches write, and fails if it differs. ``--small`` runs the small versions, which is
what CI does with ``--check``; their numbers are not for the README and are not written.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import paper
import peers
import scaling
from bench_table import Table, faults_of_readme, markdown, put_into_readme

Bench = Callable[[Path], Table]


def benches(*, small: bool) -> dict[str, Bench]:
    """Return the benches by the name of their table."""
    return {
        "paper": lambda folder: paper.measure(folder, small=small),
        "peers": lambda folder: peers.measure(folder, small=small),
        "scaling": lambda folder: scaling.measure(folder, small=small, large=not small),
    }


def main() -> None:
    """Run, then write or check."""
    small, check = "--small" in sys.argv, "--check" in sys.argv
    known = benches(small=small)
    names = [a for a in sys.argv[1:] if not a.startswith("--")] or list(known)
    if unknown := set(names) - set(known):
        raise SystemExit(f"no bench {', '.join(sorted(unknown))}; known are {', '.join(known)}")
    with tempfile.TemporaryDirectory() as folder:
        tables = [known[name](Path(folder) / name) for name in names]
    for table in tables:
        print(f"\n{markdown(table)}")
    if check:
        if faults := faults_of_readme(tables):
            raise SystemExit("README.md: " + "; ".join(faults) + " (run tests/bench/readme_tables.py)")
        print("\nREADME.md: the tables fit")
    elif small:
        raise SystemExit("small numbers are not for the README: leave out --small, or add --check")
    else:
        put_into_readme(tables)


if __name__ == "__main__":
    main()
