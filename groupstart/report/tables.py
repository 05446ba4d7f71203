"""Plan and trace as tables of columns, and their files: CSV with what is built in, Parquet with the extra ``trace``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from sim.trace import Trace

Table = dict[str, npt.NDArray[Any]]
ROWS_AT_ONCE = 100_000


class MissingExtraError(Exception):
    """A package that only an extra installs is not there."""


def plan_table(arrays: Mapping[str, npt.NDArray[Any]]) -> Table:
    """``t_s``, positions and velocities by axis, ``line``, of the arrays of a plan.npz."""
    axes = [str(axis) for axis in arrays["axes"]]
    table: Table = {"t_s": arrays["t_s"]}
    table |= {axis: arrays["q"][:, k] for k, axis in enumerate(axes)}
    table |= {f"v_{axis}": arrays["v"][:, k] for k, axis in enumerate(axes)}
    return table | {"line": arrays["line"]}


def trace_tables(trace: Trace) -> dict[str, Table]:
    """``steps``, ``servos`` and ``bus`` of a trace; motors by name."""
    names = np.array(trace.axes)
    return {
        "steps": {
            "motor": names[trace.run_axis], "first_ns": trace.run_first_ns, "period_ns": trace.run_period_ns,
            "count": trace.run_count, "direction": trace.run_dir,
        },
        "servos": {
            "motor": names[trace.servo_axis], "time_ns": trace.servo_ns, "command": trace.servo_command,
            "position": trace.servo_position,
        },
        "bus": {
            "time_ns": trace.bus_ns, "bus": trace.bus_line // 2,
            "from": np.where(trace.bus_line % 2 == 0, "host", "modules"), "byte": trace.bus_byte,
        },
    }  # fmt: skip


def write_csv(path: Path, table: Table) -> None:
    """A head line, then a row a line; numbers as short as they are exact."""
    columns = list(table.values())
    with path.open("w", encoding="utf-8", newline="") as file:
        file.write(",".join(table) + "\n")
        for first in range(0, len(columns[0]), ROWS_AT_ONCE):
            part = [column[first : first + ROWS_AT_ONCE].tolist() for column in columns]
            file.writelines(",".join(map(str, row)) + "\n" for row in zip(*part, strict=True))


def write_parquet(path: Path, table: Table) -> None:
    """Integers delta-packed, everything compressed by zstd. Raises MissingExtraError without pyarrow."""
    try:
        import pyarrow as pa
        from pyarrow import parquet
    except ImportError:
        raise MissingExtraError("Parquet needs pyarrow: pip install 'groupstart[trace]'") from None
    whole = [name for name, column in table.items() if column.dtype.kind in "iu" and column.dtype.itemsize >= 4]
    parquet.write_table(
        pa.table({name: column.astype(str) if column.dtype.kind == "U" else column for name, column in table.items()}),
        path,
        compression="zstd",
        use_dictionary=[name for name, column in table.items() if column.dtype.kind == "U"],
        column_encoding=dict.fromkeys(whole, "DELTA_BINARY_PACKED"),
    )
