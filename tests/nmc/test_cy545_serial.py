"""The modem lines of a CY545's port: which one is driven and read, and what is said where there is none."""

import os
from types import SimpleNamespace
from typing import Any

import pytest

from nmc.cy545_serial import Cy545SerialLink
from nmc.errors import NmcError


@pytest.fixture
def terminal() -> Any:
    master, slave = os.openpty()
    yield os.ttyname(slave)
    os.close(master)
    os.close(slave)


def test_lines_go_where_the_machine_file_says(terminal: str) -> None:
    link = Cy545SerialLink(terminal, 9600)
    real = link._port
    link._port = SimpleNamespace(rts=False, dtr=False, cts=True, dsr=False, cd=False, ri=False)
    link._abort_line, link._home_line, link._cts = "dtr", "dsr", True
    link.pull_abort(False)
    assert (link._port.dtr, link._port.rts) == (True, False)
    link.pull_abort(True)  # what also happens when the port is closed
    assert link._port.dtr is False
    assert not link.switch_closed()
    link._port.dsr = True
    assert link.switch_closed()
    assert link.clear_to_send()
    link._port.cts = False
    assert not link.clear_to_send()
    real.close()


def test_lines_that_are_not_wired_do_nothing(terminal: str) -> None:
    link = Cy545SerialLink(terminal, 9600)
    link.pull_abort(True)
    assert not link.switch_closed()
    assert link.clear_to_send()
    link.close()


@pytest.mark.parametrize("line", ["rts", "dtr"])
def test_a_port_without_modem_lines_says_so(terminal: str, line: Any) -> None:
    with pytest.raises(NmcError, match=f"has no line {line}"):
        Cy545SerialLink(terminal, 9600, line)
