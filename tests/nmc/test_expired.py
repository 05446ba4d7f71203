"""An exchange whose time has passed does not leave, and says so."""

from nmc.bus import Bus
from nmc.program import Exchange
from nmc.setup import ModuleExpectation, start_up
from sim.build import build
from sim.spec import BusSpec, StepModule


def test_nothing_leaves_after_the_last_safe_moment() -> None:
    simulation = build([BusSpec("main", (StepModule("X"),))], seed=1)
    bus = Bus(simulation.links[0])
    start_up(bus, [ModuleExpectation("pic-step")])
    now, packets = bus.link.now_ns(), bus.counters.packets
    late = bus.exchange(Exchange(1, 0xE, send_at_ns=now + 2_000_000, not_after_ns=now + 1_000_000))
    assert not late.sent
    assert late.status is None
    assert bus.counters.packets == packets
    assert bus.counters.expired == 1
    good = bus.exchange(Exchange(1, 0xE, not_after_ns=bus.link.now_ns() + 1_000_000))
    assert good.sent
    assert good.status is not None


def test_a_silent_group_command_expires_as_well() -> None:
    simulation = build([BusSpec("main", (StepModule("X"),))], seed=1)
    bus = Bus(simulation.links[0])
    start_up(bus, [ModuleExpectation("pic-step", leader=False)])
    now = bus.link.now_ns()
    late = bus.exchange(Exchange(0x82, 0xC, send_at_ns=now + 2_000_000, not_after_ns=now + 1_000_000))
    assert not late.sent
    assert bus.counters.expired == 1
