"""Makes extension modules of the sources named on the command line, in place: run in a folder of its own.

A script, for mypyc ends the interpreter on an error: ``python -P mypyc_build.py LIBRARY_GROUP FILE ...``.
"""

from __future__ import annotations

import sys

from mypyc.build import mypycify
from setuptools import Distribution
from setuptools.command.build_ext import build_ext

CONFIG = "mypy.ini"
"""Of the folder: what mypy must not look into."""


def main(group: str, sources: list[str]) -> None:
    """Compile; what goes wrong is told on stderr and by the exit status."""
    extensions = mypycify([f"--config-file={CONFIG}", *sources], opt_level="2", debug_level="0", group_name=group)
    command = build_ext(Distribution({"name": group, "ext_modules": extensions}))
    command.inplace = True
    command.ensure_finalized()
    command.run()


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
