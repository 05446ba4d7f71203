"""Dialects as a small table: what a control other than LinuxCNC reads differently."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Dialect:
    """One dialect. Every field says what differs from LinuxCNC; ``refused`` is the reason why it is not interpreted.

    tap_axes_as_linuxcnc: G74 and G84 outside G17 move as LinuxCNC moves (wrongly).
    """

    name: str
    about: str
    tap_axes_as_linuxcnc: bool = False
    refused: str = ""


DIALECTS: dict[str, Dialect] = {
    dialect.name: dialect
    for dialect in (
        Dialect("linuxcnc", "RS274/NGC as LinuxCNC 2.9 reads it", tap_axes_as_linuxcnc=True),
        Dialect("grbl", "grbl 1.1 and its family"),
        Dialect("fanuc", "Fanuc and Haas, with Macro B"),
        Dialect("mach", "Mach3 and Mach4"),
        Dialect("marlin", "3D printers", refused="3D printer programs extrude with E and home with G28"),
    )
}
