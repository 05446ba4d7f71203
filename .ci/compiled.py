"""Compiled and not, a verify must not differ in one byte: verdict and trace (every byte and pulse) are compared.

    python .ci/compiled.py PROGRAM MACHINE[:PROFILE] ...     with the groupstart of this Python

Exit status 1 if anything differs, or if nothing is compiled.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

GROUPSTART = [sys.executable, "-m", "groupstart"]


def outcome(program: str, machine: str, profile: str, compiled: bool) -> tuple[int, bytes, bytes]:
    """Exit status, verdict and trace."""
    with tempfile.TemporaryDirectory() as folder:
        trace = Path(folder) / "trace.npz"
        command = [*GROUPSTART, "verify", program, "-m", machine, "--profile", profile, "--json", "--trace", str(trace)]
        environment = os.environ | {"GROUPSTART_COMPILED": str(int(compiled))}
        done = subprocess.run(command, env=environment, capture_output=True, check=False)
        if done.returncode not in (0, 1) or not trace.exists():
            sys.stderr.buffer.write(done.stderr)
            raise SystemExit(f"{machine} {profile}: no verdict")
        return done.returncode, done.stdout, trace.read_bytes()


def main(program: str, machines: list[str]) -> int:
    """Compare on each machine."""
    status = subprocess.run(
        [sys.executable, "-m", "groupstart.compiling", "--status"], capture_output=True, text=True, check=True
    ).stdout.strip()
    print(status)
    if not status.endswith("are compiled"):
        return 1
    differ = False
    for each in machines:
        machine, _, profile = each.partition(":")
        same = outcome(program, machine, profile or "auto", False) == outcome(program, machine, profile or "auto", True)
        print(f"{each:30s} {'the same' if same else 'DIFFERS'}")
        differ |= not same
    return int(differ)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], sys.argv[2:]))
