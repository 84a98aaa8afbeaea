"""Lets ``python -m cmm_align`` stand for the ``cmm-align`` command."""

from cmm_align.cli.main import run

if __name__ == "__main__":
    run()
