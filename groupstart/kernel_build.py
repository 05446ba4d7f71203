"""Makes the library of kernels (``nmc.native``): ``python -P kernel_build.py ROOT FOLDER MODULE ...``.

A script, run in a process of its own: it imports the sources of ROOT, never what is compiled of them. numba writes code
for any processor of this kind, not only for this one.
"""

from __future__ import annotations

import sys
import warnings
from importlib import import_module


def main(root: str, folder: str, modules: list[str]) -> None:
    """Compile; what goes wrong is told on stderr and by the exit status."""
    sys.path.insert(0, root)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # numba says that it will have something else for this one day
        from numba.pycc import CC
    from nmc.native import LIBRARY, OFFERED

    for module in modules:
        import_module(module)
    library = CC(LIBRARY)
    library.output_dir = folder
    for name, signature, function in OFFERED:
        library.export(name, signature)(function)
    library.compile()


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], sys.argv[3:])
