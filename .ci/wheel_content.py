"""The wheel holds the six packages and nothing else at its top level, and the data that the main job needs."""

from __future__ import annotations

import sys
import zipfile

PACKAGES = {"groupstart", "machines", "planner", "sim", "gcode", "nmc"}
DATA = ("groupstart/data/compass.nc", "machines/data/mill3-step.toml")


def main(wheel: str) -> int:
    """0 if the wheel is as it must be."""
    names = zipfile.ZipFile(wheel).namelist()
    top = {name.split("/")[0] for name in names}
    packages = {name for name in top if not name.endswith(".dist-info")}
    missing = [name for name in DATA if name not in names]
    if packages != PACKAGES or missing:
        print(f"wheel: top level {sorted(packages)}, missing data {missing}")
        return 1
    print(f"wheel: {len(names)} files in {', '.join(sorted(packages))}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
