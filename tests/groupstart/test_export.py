"""Exports: what stands in the files, read back by the shortest readers that can be written."""

import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from groupstart.report.perfetto import Sample, Slice, perfetto_trace
from groupstart.report.plotfile import extremes
from groupstart.report.vcd import Signal, vcd_lines

Cli = Callable[..., Any]
PROGRAM = "G21 G90 G64 P0.01 F1200\nG1 X6\nG1 Y4\nG1 X5 Z-1\nM2\n"


@pytest.fixture
def files(tmp_path: Path, cli: Cli) -> Path:
    program = tmp_path / "part.nc"
    program.write_text(PROGRAM)
    assert cli("plan", str(program), "-o", str(tmp_path / "plan.npz")).status == 0
    assert cli("verify", str(program), "--trace", str(tmp_path / "trace.npz")).status == 0
    return tmp_path


def test_the_plan_as_csv_is_the_plan(files: Path, cli: Cli) -> None:
    target = files / "plan.csv"
    assert cli("export", str(files), "-o", str(target)).status == 0
    head, *rows = target.read_text().splitlines()
    assert head == "t_s,X,Y,Z,v_X,v_Y,v_Z,line"
    table = np.array([[float(cell) for cell in row.split(",")] for row in rows])
    with np.load(files / "plan.npz") as plan:
        assert np.array_equal(table[:, 0], plan["t_s"])
        assert np.array_equal(table[:, 1:4], plan["q"])
        assert np.array_equal(table[:, 7], plan["line"])


def test_steps_and_bus_as_csv(files: Path, cli: Cli) -> None:
    trace = str(files / "trace.npz")
    assert cli("export", trace, "-o", str(files / "steps.csv")).status == 0
    steps = [row.split(",") for row in (files / "steps.csv").read_text().splitlines()[1:]]
    assert {row[0] for row in steps} == {"X", "Y", "Z"}
    assert sum(int(row[3]) * int(row[4]) for row in steps if row[0] == "X") == 1000
    assert cli("export", trace, "-o", str(files / "bus.csv"), "--table", "bus").status == 0
    bus = [row.split(",") for row in (files / "bus.csv").read_text().splitlines()[1:]]
    assert {row[2] for row in bus} == {"host", "modules"}
    assert [row[3] for row in bus[:3]] == ["0", "0", "0"]  # the nulls of start-up


def test_vcd_has_every_pulse_and_the_directions(files: Path, cli: Cli) -> None:
    target = files / "pins.vcd"
    assert cli("export", str(files / "trace.npz"), "-o", str(target)).status == 0
    lines = target.read_text().splitlines()
    code = {line.split()[4]: line.split()[3] for line in lines if line.startswith("$var")}
    assert set(code) == {f"{axis}_{pin}" for axis in "XYZ" for pin in ("step", "dir")}
    body = lines[lines.index("$enddefinitions $end") :]
    with np.load(files / "trace.npz") as trace:
        for number, axis in enumerate("XYZ"):
            pulses = int(trace["run_count"][trace["run_axis"] == number].sum())
            assert body.count("1" + code[f"{axis}_step"]) == pulses
    times = [int(line[1:]) for line in body if line.startswith("#")]
    assert times == sorted(times)
    level, position = {}, dict.fromkeys("XYZ", 0)
    for line in body:
        if line[:1] in "01" and line[1:]:
            level[line[1:]] = line[0]
            for axis in "XYZ":
                if line == "1" + code[f"{axis}_step"]:
                    position[axis] += 1 if level[code[f"{axis}_dir"]] == "1" else -1
    assert position == {"X": 1000, "Y": 800, "Z": -200}


def test_vcd_names_many_signals_and_real_numbers() -> None:
    signals = [Signal(f"s{k}", np.array([k], dtype=np.int64), np.array([1.0])) for k in range(200)]
    signals.append(Signal("pwm", np.array([5], dtype=np.int64), np.array([0.25]), real=True))
    lines = list(vcd_lines(signals))
    codes = [line.split()[3] for line in lines if line.startswith("$var")]
    assert len(set(codes)) == 201
    assert f"r0.25 {codes[-1]}" in lines


def fields(data: bytes) -> Iterator[tuple[int, Any]]:
    """Fields of a protobuf message: number, and its integer, double or bytes."""
    at = 0

    def varint() -> int:
        nonlocal at
        value = shift = 0
        while True:
            byte = data[at]
            at += 1
            value |= (byte & 0x7F) << shift
            shift += 7
            if byte < 0x80:
                return value

    while at < len(data):
        key = varint()
        if key & 7 == 0:
            yield key >> 3, varint()
        elif key & 7 == 1:
            yield key >> 3, struct.unpack("<d", data[at : at + 8])[0]
            at += 8
        else:
            size = varint()
            yield key >> 3, data[at : at + size]
            at += size


def test_perfetto_trace_has_tracks_slices_and_counters() -> None:
    data = b"".join(perfetto_trace(
        {1: "bus"}, [Slice(1, 1000, 300_000_000_000, "load")], {2: "rate"}, [Sample(2, 7, -2.5)]))  # fmt: skip
    packets = [dict(fields(packet)) for number, packet in fields(data) if number == 1]
    assert len(packets) == 5
    assert dict(fields(packets[0][60])) == {1: 1, 2: b"bus"}
    assert dict(fields(packets[1][60])) == {1: 2, 2: b"rate", 8: b""}
    assert packets[2][8] == 1000
    assert dict(fields(packets[2][11])) == {9: 1, 11: 1, 23: b"load"}
    assert packets[3][8] == 300_000_000_000
    assert dict(fields(packets[4][11])) == {9: 4, 11: 2, 44: -2.5}


def test_the_bus_timeline_has_every_packet_in_order(files: Path, cli: Cli) -> None:
    target = files / "bus.perfetto-trace"
    assert cli("export", str(files / "trace.npz"), "-o", str(target)).status == 0
    open_at: dict[int, int] = {}
    count = {1: 0, 2: 0}
    for _, packet in fields(target.read_bytes()):
        values = dict(fields(packet))
        if 11 not in values:
            continue
        event = dict(fields(values[11]))
        track = event[11]
        if event[9] == 1:
            assert values[8] >= open_at.get(track, 0)
            open_at[track] = values[8]
        elif event[9] == 2:
            assert values[8] > open_at[track]
            open_at[track] = values[8]
            count[track] += 1
    assert count[1] > 100
    assert count[2] > 100


@pytest.mark.parametrize(("source", "plot"), [("plan.npz", "velocity"), ("plan.npz", "speed"), ("trace.npz", "rate")])
def test_plots_are_drawn(source: str, plot: str, files: Path, cli: Cli) -> None:
    target = files / "plot.svg"
    assert cli("export", str(files / source), "-o", str(target), "--plot", plot).status == 0
    assert target.read_text().startswith("<?xml")


def test_thinned_series_keep_their_extremes() -> None:
    t = np.linspace(0, 1, 50_000)
    values = np.sin(40 * t)
    values[31_234] = 9
    few_t, few = extremes(t, values, 100)
    assert len(few) <= 202
    assert few.max() == 9
    assert few.min() == values.min()
    assert np.all(np.diff(few_t) > 0)


def test_parquet_reads_back(files: Path, cli: Cli) -> None:
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed (the extra 'trace')")
    target = files / "plan.parquet"
    assert cli("export", str(files / "plan.npz"), "-o", str(target)).status == 0
    table = parquet.read_table(target)
    with np.load(files / "plan.npz") as plan:
        assert np.array_equal(table["t_s"].to_numpy(), plan["t_s"])
        assert np.array_equal(table["line"].to_numpy(), plan["line"])


def test_what_is_no_plan_or_trace_is_refused_in_words(files: Path, cli: Cli) -> None:
    assert cli("export", str(files / "part.nc"), "-o", str(files / "x.vcd")).status == 1
    assert cli("export", str(files / "none.npz"), "-o", str(files / "x.csv")).status == 2
    answer = cli("export", str(files / "plan.npz"), "-o", str(files / "x.doc"))
    assert answer.status == 2
    assert ".parquet" in answer.err
