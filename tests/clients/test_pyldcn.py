"""pyldcn, a host library for the LDCN dialect, on virtual steppers.

Strictly by the PIC-STEP data sheet two things of the dialect must be changed (status item bit 6, six parameter
bytes); with the simulator's ``ldcn`` option nothing has to be.
"""

from __future__ import annotations

import pytest

from sim.spec import StepModule

pyldcn = pytest.importorskip("pyldcn")
pytestmark = pytest.mark.clients

MOVING = 0x01


def run_to(client, address: int, goal: int) -> int:
    client.StepLoadTraj(address, goal, 50, 10)
    for _ in range(400):
        client.LdcnReadStatus(address, 1)
        if not client.LdcnGetStat(address) & MOVING and client.LdcnGetDevice(address)["modspecific"][1] == goal:
            break
    return client.LdcnGetDevice(address)["modspecific"][1]


def open_client(port: str):
    client = pyldcn.pyldcn(port)
    client.serial.timeout = 0.5
    return client


def test_ldcn_dialect_unchanged(serve) -> None:
    _, port = serve(StepModule("a", ldcn=True), StepModule("b", ldcn=True))
    client = open_client(port)
    assert client.LdcnInit() == 2
    assert client.GetSteppers() == [1, 2]
    for address in (1, 2):
        client.StepStopMotor(address, 9)
        client.StepSetParam(address, 0, 1, 255, 5, 0, 10)
        client.StepResetPos(address)
    assert run_to(client, 1, 1500) == 1500
    assert run_to(client, 2, -700) == -700
    client.LdcnShutdown()


def test_strict_pic_steps_with_the_two_documented_changes(serve_machine, monkeypatch) -> None:
    monkeypatch.setitem(pyldcn.pyldcn.stepper_read_status, "SEND_ALL", 0x3F)
    client = open_client(serve_machine("mill3-step"))
    assert client.LdcnInit() == 3
    assert [device["modtype"] for device in client.devices] == [3, 3, 3]
    client.StepStopMotor(1, 9)
    client.LdcnSendCmd(1, 0x56, bytes([0, 1, 255, 5, 0]), nread=2)
    client.StepResetPos(1)
    assert run_to(client, 1, 2000) == 2000
    client.LdcnShutdown()
