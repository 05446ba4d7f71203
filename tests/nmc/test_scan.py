"""Finding the rate and the modules."""

from __future__ import annotations

import pytest

from nmc.bus import Bus
from nmc.errors import LinkTimeout
from nmc.scan import find_baud, scan
from nmc.setup import ModuleExpectation, change_baud, start_up
from sim.build import build
from sim.spec import BusSpec, StepModule

RATES = [9600, 19200, 57600, 115200]


def network(count: int = 2):
    modules = tuple(StepModule(f"m{number}") for number in range(count))
    return build([BusSpec("bus", modules)], 5).links[0]


@pytest.mark.parametrize("baud", RATES)
def test_the_rate_is_found(baud: int) -> None:
    link = network()
    bus = Bus(link)
    start_up(bus, [ModuleExpectation("pic-step")] * 2, baud)
    assert find_baud(Bus(link)) == baud


def test_nobody_at_home() -> None:
    bus = Bus(network(0))
    assert find_baud(bus) is None
    assert bus.baud == 19200
    with pytest.raises(LinkTimeout, match="nobody answers"):
        scan(bus)


def test_a_fresh_network_is_given_addresses() -> None:
    result = scan(Bus(network(3)))
    assert result.baud == 19200
    assert [(found.address, found.chip, found.version) for found in result.modules] == [
        (1, "pic-step", 1),
        (2, "pic-step", 1),
        (3, "pic-step", 1),
    ]
    assert result.modules[0].text().startswith("  1  pic-step (type 3) version 1: power_sense; position 0")
    assert result.modules[0].as_json()["flags"] == ["power_sense"]


def test_a_running_network_is_only_read() -> None:
    link = network()
    bus = Bus(link)
    start_up(bus, [ModuleExpectation("pic-step")] * 2)
    result = scan(Bus(link))
    assert (result.baud, len(result.modules)) == (115200, 2)


def test_reset_brings_everybody_back() -> None:
    link = network()
    start_up(Bus(link), [ModuleExpectation("pic-step")] * 2)
    assert scan(Bus(link), reset=True).baud == 19200


def test_the_rate_of_a_running_network_changes() -> None:
    bus = Bus(network(3))
    start_up(bus, [ModuleExpectation("pic-step")] * 3)
    change_baud(bus, 57600, 21)
    assert {module.group for module in bus.guard.modules.values()} == {0x82}
    assert bus.guard.modules[1].leader
    change_baud(bus, 9600)
    assert find_baud(Bus(bus.link)) == 9600
