"""Build hook: wheels get compiled modules where there is a C compiler; everything works without them.

GROUPSTART_COMPILE=0 leaves them out, =1 makes it an error if they cannot be made. An editable install never has them:
there one compiles by hand (``python -m groupstart.compiling``), and edited sources win over what was compiled.
"""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

SWITCH = "GROUPSTART_COMPILE"


class CustomBuildHook(BuildHookInterface):  # type: ignore[type-arg]  # hatchling's own configuration class
    """Compiles into a folder of its own, from which the files are put into the wheel."""

    def _compiling(self) -> Any:
        sys.path.insert(0, self.root)
        try:
            from groupstart import compiling
        finally:
            sys.path.remove(self.root)
        return compiling

    def dependencies(self) -> list[str]:
        """What compiling needs, if it will be tried."""
        if "get_requires_for_build_editable" in sys.argv:  # hatchling does not say; at worst too much is fetched
            return []
        compiling = self._compiling()
        wanted = os.environ.get(SWITCH) != "0" and compiling.c_compiler() is not None
        return list(compiling.REQUIRED) if wanted else []

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile and add what was made, in wheels that are not editable."""
        if version == "editable" or os.environ.get(SWITCH) == "0":
            return
        compiling = self._compiling()
        self._folder = Path(tempfile.mkdtemp(prefix="groupstart-wheel-"))
        try:
            files = compiling.compile_into(self._folder / "compiled", Path(self.root))
        except (compiling.CompileError, OSError) as error:
            if os.environ.get(SWITCH) == "1":
                raise
            self.app.display_warning(f"groupstart is built without compiled modules: {error}")
            return
        for file in files:
            build_data["force_include"][str(self._folder / "compiled" / file)] = f"groupstart/_compiled/{file}"
        build_data["pure_python"] = False
        build_data["infer_tag"] = True

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove the folder."""
        folder = getattr(self, "_folder", None)
        if folder is not None:
            shutil.rmtree(folder, ignore_errors=True)
