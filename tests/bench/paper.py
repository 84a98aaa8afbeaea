"""The source paper, figure by figure: ``python tests/bench/paper.py [FOLDER] [--small] [--readme]``.

Photonics 2025, 12(5), 469, doi 10.3390/photonics12050469. The folder (cmm-align-paper unless given) gets a
table (CSV) and a picture (PNG) for each figure, and paper.md: what the paper says, what we found, how it was
measured. The part is the virtual window, whose truth is known; the paper's own data were not published.
``--small`` takes fewer points and less than a minute; ``--readme`` puts the table into README.md.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import NamedTuple

from bench_table import Line, Table, markdown, put_into_readme
from paper_loop import loop
from paper_mismatch import iterations, mismatch, time_against_n, with_noise
from paper_surface import density, equidistant
from window_cloud import PAPER_NODES, grid_nominal

COMMAND = "python tests/bench/paper.py"
FOLDER = "cmm-align-paper"


class Sizes(NamedTuple):
    """How much is measured."""

    nodes: tuple[int, int] = PAPER_NODES
    density_stride: int = 2
    equidistant: tuple[int, int] = (451, 401)
    iterations: int = 6000
    noisy: int = 79_190
    time: tuple[int, ...] = (10_000, 40_000, 160_000, 400_000, 1_200_000)
    repeats: int = 3
    loop_nodes: tuple[int, int] = (451, 401)
    scan: tuple[int, int] = (81, 161)


SMALL = Sizes(
    nodes=(103, 125),
    density_stride=1,
    equidistant=(91, 81),
    iterations=1500,
    noisy=5000,
    time=(2000, 8000, 32_000),
    repeats=2,
    loop_nodes=(103, 63),
    scan=(31, 61),
)


ABOUT = """\
Photonics 2025, 12(5), 469, doi 10.3390/photonics12050469. Its surface and its data were not published: the
part here is the virtual window (102 × 62 mm, slopes to 45°), whose truth is known. What it says of a machine
(Fig. 7 to 9) is repeated with a virtual grinder (transfer 0.96, repeatability 0.8 µm) and 0.3 µm of noise: it
shows that the loop closes, not what a grinder can do."""
PICTURES = {
    "fig2_density": "Fig. 2. Simulated error along the normal (left), error of point-to-triangle distances "
    "and of distances to the smooth surface, at the middles of the cells, where facets are worst.",
    "fig3_equidistant": "Fig. 3. The nominal and its equidistant surface, one tip radius out.",
    "fig4_slope_curvature": "Fig. 4. Slope, curvatures, features and the reach of the ball.",
    "fig5_6_mismatch": "Fig. 5 and 6. The cloud laid off by 20, 10, 20 mm and 20, 10, 20°, and the "
    "objective at each step from several starts, each s mm and s° along and about the space diagonal. "
    "Noise-free points, every 16th node. The first step from far off lays the principal axes of the cloud on "
    "those of the nominal: these starts become one. A few points carry the steps, all of them the last.",
    "iterations": "Iterations of the methods from the same start, with 27 µm of form error. The residuals "
    "are their own: distances to vertices, tangent planes, facets; ours to the surface.",
    "time": "Time against the number of points; nominal and start of the paper.",
    "fig9_passes": "Fig. 7 to 9. Ground, measured, corrected, ground again, by the virtual grinder.",
    "fig10_contact_points": "Fig. 10. Contact points aligned to the nominal (left) and what the radius, "
    "subtracted after a vertical look-up, does to the deviations (right).",
}


def measure(folder: Path, *, small: bool) -> Table:
    """Write tables and pictures of all figures; return the claims beside our figures."""
    sizes = SMALL if small else Sizes()
    folder.mkdir(parents=True, exist_ok=True)
    lines: list[Line] = []
    lines += density(folder, sizes.nodes, sizes.density_stride)
    lines += equidistant(folder, sizes.equidistant)
    nominal = grid_nominal(sizes.nodes)
    lines += mismatch(folder, nominal)
    lines += iterations(folder, nominal, sizes.iterations)
    lines += with_noise(nominal, sizes.noisy)
    lines += time_against_n(folder, nominal, list(sizes.time), sizes.repeats)
    lines += loop(folder, sizes.loop_nodes, *sizes.scan)
    table = Table(
        "paper",
        ("claim of the paper", "it says, or bar", "measured here"),
        tuple(lines),
        COMMAND + (" --small" if small else ""),
        (f"Nominal of {sizes.nodes[0]} × {sizes.nodes[1]} nodes, tip radius 1.5 mm.",),
    )
    (folder / "paper.md").write_text(paper_md(folder, table), encoding="utf-8")
    return table


def paper_md(folder: Path, table: Table) -> str:
    """Return the page: the table, how each figure was made, the pictures."""
    shown = [
        f"![{name}]({name}.png)\n\n{words}\n"
        for name, words in PICTURES.items()
        if (folder / f"{name}.png").exists()
    ]
    return "\n".join(["# The paper, figure by figure", "", ABOUT, "", markdown(table), "", *shown])


def main() -> None:
    """Measure and write."""
    arguments = [a for a in sys.argv[1:] if not a.startswith("--")]
    folder = Path(arguments[0] if arguments else FOLDER)
    table = measure(folder, small="--small" in sys.argv)
    print(markdown(table))
    if "--readme" in sys.argv:
        put_into_readme([table])


if __name__ == "__main__":
    main()
