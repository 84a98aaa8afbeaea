"""`cmm-align selftest`: known answers, and how near the installed software comes to them."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from cmm_align.cli import options
from cmm_align.cli.job import EXIT_OF_VERDICT, Job, Outcome
from cmm_align.cli.options import FILE
from cmm_align.errors import UsageError

if TYPE_CHECKING:
    from cmm_align.selftest import Check

TEXT = """Proof on this machine: cases whose answer is known, measured with the installed software.

Closed-form distances, best fits and minimum zones known exactly, a wrong ball on caps, two paths to one
deviation, the replay of a serial port. Each error stands beside what the software states of itself, 1 nm
and 1e-9 rad. A certificate (JSON) is stored; the exit code is 5 where an error is larger.
"""

SCHEMA: Final = "cmm-align/selftest"


@options.command("selftest", TEXT)
@click.option(
    "-o",
    "--output",
    type=FILE,
    metavar="FILE",
    help="Certificate, a name in .json.  [default: cmm-align-selftest-<time>.json here]",
)
def command(job: Job, *, output: Path | None) -> int:
    """Parse, call, show."""
    from cmm_align.cli.show import finish

    return finish(job, run_selftest(job, output))


def run_selftest(job: Job, output: Path | None = None) -> Outcome:
    """Run all checks and write the certificate.

    Parameters
    ----------
    job : Job
    output : Path, optional
        In the current folder with the time in its name unless given.

    Raises
    ------
    UsageError
        If the name of the certificate does not end in .json.
    OutputError
        If it cannot be written, or would replace what is no certificate; found out before the checks run.
    """
    from cmm_align.cli.progress import progress_bar
    from cmm_align.io.atomic import atomic_path, check_writable
    from cmm_align.provenance import this_step
    from cmm_align.selftest import CHECKS, run

    step = this_step(job.command, {})
    stamp = step.time_utc.replace("-", "").replace(":", "")
    output = output or Path(f"cmm-align-selftest-{stamp}.json")
    if output.suffix.lower() != ".json":  # by its name it would be, and could replace, something else
        raise UsageError(
            f"{output.name!r} is no name for a certificate",
            where=str(output),
            expected="a name that ends in .json",
            remedy=f"give -o {output.with_suffix('.json').name}",
        )
    check_writable(output, job.overwrite)
    found: list[Check] = []
    with progress_bar(job) as tell:
        checks = run()
        for number, case in enumerate(CHECKS):
            if tell is not None:
                tell(case.name, number / len(CHECKS))
            found.append(next(checks))
    result = {"passed": all(check.passed for check in found), **_result(found)}
    certificate = {
        "schema": SCHEMA,
        "version": step.version,
        "time_utc": step.time_utc,
        **_machine(),
        **result,
    }
    with atomic_path(output, job.overwrite) as path:
        path.write_text(json.dumps(certificate, indent=2, allow_nan=False) + "\n", encoding="utf-8")
    verdict = "pass" if result["passed"] else "fail"
    return Outcome(
        command=job.command,
        noun=tuple(found),
        inputs=[],
        outputs=[output],
        result=result,
        rows=[(check.name, _in_words(check)) for check in found],
        details=[
            (finding.what, f"{finding.error:.1e} {finding.unit} of {finding.n}")
            for check in found
            for finding in check.findings
        ],
        verdict=verdict.upper(),
        reasons=_reasons(found),
        advice=""
        if result["passed"]
        else "do not use this installation: install again, and if it stays so, report the certificate",
        exit_code=EXIT_OF_VERDICT[verdict],
    )


def _result(checks: list[Check]) -> dict[str, Any]:
    """Return the checks as JSON; what is not finite is null."""
    from cmm_align.selftest import MPE_NM, MPE_RAD

    return {
        "stated_error_nm": MPE_NM,
        "stated_error_rad": MPE_RAD,
        "largest_error_nm": _finite(_largest(checks, "nm")),
        "largest_error_rad": _finite(_largest(checks, "rad")),
        "checks": [
            {
                "name": check.name,
                "passed": check.passed,
                "seconds": round(check.seconds, 3),
                "trouble": check.trouble or None,
                "findings": [
                    {
                        "what": f.what,
                        f"error_{f.unit}": _finite(f.error),
                        f"limit_{f.unit}": f.limit,
                        "n": f.n,
                    }
                    for f in check.findings
                ],
            }
            for check in checks
        ],
    }


def _machine() -> dict[str, Any]:
    """Return what the certificate holds for: the interpreter, its libraries, the kind of machine."""
    import os
    import platform
    from importlib.metadata import version

    return {
        "computer": platform.node(),
        "python": platform.python_version(),
        "platform": platform.platform(),
        "processor": platform.processor() or platform.machine(),
        "cores": os.cpu_count(),
        "libraries": {name: version(name) for name in ("numpy", "scipy", "h5py", "pyserial")},
    }


def _largest(checks: list[Check], unit: str) -> float:
    """Return the largest error of all checks in a unit, NaN where one is not known."""
    errors = [error for check in checks if (error := check.largest(unit)) is not None]
    return math.nan if not errors or any(math.isnan(e) for e in errors) else max(errors)


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _in_words(check: Check) -> str:
    """Return the largest errors of a check, and how long it took."""
    if check.trouble:
        return f"NOT PASSED: {check.trouble}"
    told = [
        f"{error:.1e} {unit}" if unit != "points" else f"{error:.0f} points wrong"
        for unit in ("nm", "rad", "points")
        if (error := check.largest(unit)) is not None
    ]
    return f"{'' if check.passed else 'NOT PASSED: '}{', '.join(told)}   ({check.seconds:.1f} s)"


def _reasons(checks: list[Check]) -> list[str]:
    """Return the verdict in sentences: the largest errors beside the stated ones."""
    from cmm_align.selftest import MPE_NM, MPE_RAD

    lines = [
        f"largest error {_largest(checks, unit):.1e} {unit}, stated {limit:g} {unit}"
        for unit, limit in (("nm", MPE_NM), ("rad", MPE_RAD))
    ]
    bad = [check.name for check in checks if not check.passed]
    return [*lines, f"not passed: {', '.join(bad)}"] if bad else lines
