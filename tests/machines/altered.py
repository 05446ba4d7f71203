"""A shipped machine file with other words in it."""

from pathlib import Path

from machines.load import MachineFile, read_machine


def machine_of(tmp_path: Path, name: str, *changes: tuple[str, str]) -> MachineFile:
    """The machine after each (old, new) of ``changes``, written to ``tmp_path``; what is replaced must be there."""
    text = read_machine(name).text
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new)
    path = tmp_path / f"{name}.toml"
    path.write_text(text)
    return read_machine(str(path))
