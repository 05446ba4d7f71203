"""``groupstart dump``: bus bytes as decoded packets, both directions, with times and violations."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from groupstart.exits import EXIT_FAULT, EXIT_REFUSED, VerbError

if TYPE_CHECKING:
    from nmc.recording_link import Chunk

RECORD, TRACE = "bus-*.txt", "trace.npz"


@click.command(name="dump")
@click.argument("source", type=click.Path(allow_dash=True))
@click.option("--bus", type=click.IntRange(min=0), default=0, show_default=True, help="Which bus of a trace.")
@click.option(
    "--chip", type=click.Choice(["pic-step", "pic-servo", "cy545"]), help="Chip to assume before one says its type."
)
@click.option("--complaints", is_flag=True, help="Only the packets against which a data sheet has something.")
def command(source: str, bus: int, chip: str | None, complaints: bool) -> None:
    """Decode the bytes of SOURCE: a run folder, a trace.npz, a bus record, or - for a bus record on stdin.

    A bus record has one chunk a line: time in ns, > (host) or < (modules), bytes in hex.
    """
    from nmc.chips import picservo, picstep
    from nmc.cy545_dump import dump_cy545
    from nmc.dump import dump_lines

    facts = {"pic-step": picstep.FACTS, "pic-servo": picservo.FACTS}.get(chip or "")
    count = 0
    try:
        chunks = chunks_of(source, bus)
        for line in dump_cy545(chunks) if chip == "cy545" else dump_lines(chunks, facts):
            count += len(line.complaints)
            if line.complaints or not complaints:
                click.echo(line.text())
    except ValueError as error:
        raise VerbError(f"{source}: {error}", EXIT_REFUSED) from None
    click.echo(f"{count} complaints", err=True)


def chunks_of(source: str, bus: int) -> Iterator[Chunk]:
    """The chunks of a run folder, trace or record. Raises VerbError if it is none of them."""
    from nmc.recording_link import read_record

    if source == "-":
        yield from read_record(sys.stdin)
        return
    path = Path(source)
    if path.is_dir():
        path = in_folder(path, bus)
    if path.suffix == ".npz":
        yield from trace_chunks(path, bus)
        return
    try:
        text = path.read_text(encoding="ascii")
    except OSError as error:
        raise VerbError(f"{path}: {error.strerror}", EXIT_FAULT) from None
    except UnicodeDecodeError:
        raise VerbError(f"{path}: not a bus record", EXIT_REFUSED) from None
    yield from read_record(text.splitlines())


def in_folder(folder: Path, bus: int) -> Path:
    """The bus record of a run folder (real port), or its trace (twin)."""
    records = sorted(folder.glob(RECORD))
    if bus < len(records):
        return records[bus]
    if (folder / TRACE).is_file():
        return folder / TRACE
    raise VerbError(f"{folder}: neither {RECORD} nor {TRACE} of bus {bus} in it", EXIT_FAULT)


def trace_chunks(path: Path, bus: int) -> Iterator[Chunk]:
    """The bus bytes of a trace."""
    import zipfile

    from nmc.dump import chunks_of_bytes
    from sim.trace import load

    try:
        trace = load(path)
    except OSError as error:
        raise VerbError(f"{path}: {error.strerror or error}", EXIT_FAULT) from None
    except (KeyError, ValueError, zipfile.BadZipFile):
        raise VerbError(f"{path}: not a trace", EXIT_REFUSED) from None
    yield from chunks_of_bytes(trace.bus_ns.tolist(), trace.bus_line.tolist(), trace.bus_byte.tolist(), bus)
