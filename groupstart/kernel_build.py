"""Makes the library of kernels (``nmc.native``): ``python -P kernel_build.py ROOT FOLDER MODULE ...``.

A script, run in a process of its own: it imports the sources of ROOT, never what is compiled of them. numba writes code
for any processor of this kind that is still in use (numpy asks for the same), not only for this one.
"""

from __future__ import annotations

import platform
import sys
import warnings
from importlib import import_module
from typing import Any

OLDEST = {"x86_64": "x86-64-v2"}
"""By machine; others take the oldest of their kind."""


def main(root: str, folder: str, modules: list[str]) -> None:
    """Compile; what goes wrong is told on stderr and by the exit status."""
    sys.path.insert(0, root)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # numba says that it will have something else for this one day
        from numba import njit
        from numba.pycc import CC
    from nmc.native import COMMON, LIBRARY, OFFERED

    for module in modules:
        import_module(module)
    library = CC(LIBRARY)
    library.output_dir = folder
    library.target_cpu = OLDEST.get(platform.machine(), "")
    for name, signature, function in OFFERED:
        library.export(name, signature)(forwarding(njit(**COMMON)(function)))
    library.compile()


def forwarding(kernel: Any) -> Any:
    """A function that calls a kernel: what is exported is compiled without the options that kernels have."""
    parameters = ", ".join(kernel.py_func.__code__.co_varnames[: kernel.py_func.__code__.co_argcount])
    house: dict[str, Any] = {"kernel": kernel}
    exec(f"def forward({parameters}): return kernel({parameters})", house)
    return house["forward"]


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], sys.argv[3:])
