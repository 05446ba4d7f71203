"""``[user_command.M110]``: what M100 to M199 mean on a machine.

LinuxCNC runs a program of the host; here somebody at the machine is asked while every axis rests, so no G-code file
can make the host do anything.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import Field

from gcode.canon import UserCommand
from machines.tables import Table

_NAME = re.compile(r"M1[0-9]{2}")


class UserCommandTable(Table):
    """``[user_command.M110]``. ``request``: what whoever stands at the machine is asked to do."""

    request: str = Field(min_length=1)


def user_command_checks(data: Mapping[str, Any]) -> Iterator[tuple[tuple[str, ...], str, str]]:
    """Names of tables that are no user command: key path, message, hint."""
    tables = data.get("user_command", {})
    for name in tables if isinstance(tables, dict) else ():
        if not _NAME.fullmatch(name):
            yield ("user_command", name), "a user command is one of M100 to M199", "as in [user_command.M110]"


def numbers(tables: Mapping[str, UserCommandTable]) -> frozenset[int]:
    """The codes that a machine has."""
    return frozenset(int(name[1:]) for name in tables)


def user_request(command: UserCommand, tables: Mapping[str, UserCommandTable]) -> str:
    """What somebody is asked, with the words of the line."""
    words = "".join(
        f" {letter}{value:g}" for letter, value in (("P", command.p), ("Q", command.q)) if value is not None
    )
    table = tables.get(f"M{command.number}")
    return f"line {command.line}: M{command.number}{words}" + (f": {table.request}" if table else "")
