"""The watchdog as a child process on a real descriptor: hosts that are killed, hang, or leave in order."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys

import pytest

from nmc.bus import Bus
from nmc.errors import NmcError
from nmc.picstep import PicStep
from nmc.program import Exchange
from nmc.serial_link import DescriptorLink
from nmc.setup import ModuleExpectation, start_up
from nmc.watchdog import Ward
from nmc.watchdog_process import SupervisedLink
from sim.spec import ServoModule, StepModule

pytestmark = pytest.mark.clients

CLOCK = DescriptorLink(-1, "clock")
MS = 1_000_000
HOST = """
import sys
from nmc.bus import Bus
from nmc.picstep import PicStep
from nmc.setup import ModuleExpectation, start_up
from nmc.watchdog import Ward
from nmc.watchdog_process import SupervisedLink

link = SupervisedLink(sys.argv[1])
bus = Bus(link)
start_up(bus, [ModuleExpectation("pic-step"), ModuleExpectation("pic-step")])
link.watch([Ward(1, "pic-step"), Ward(2, "pic-step")], (0x81, 0x82), baud=115200)
for address in (1, 2):
    step = PicStep(bus, address)
    step.set_parameters("2x", minimum_speed=1)
    step.stop_motor()
link.arm()
for address in (1, 2):
    PicStep(bus, address).load_trajectory(position=1_000_000, timer_count=64000, start_now=True)
print("moving", flush=True)
count = 64000
while True:
    count = count + 1 if count < 64500 else 64000
    for address in (1, 2):
        PicStep(bus, address).load_trajectory(timer_count=count, start_now=True)
"""


def wait_for(condition, timeout_ms: int = 3000) -> bool:
    """Poll a condition of another process or thread."""
    deadline_ns = CLOCK.now_ns() + timeout_ms * MS
    while not condition():
        if CLOCK.now_ns() > deadline_ns:
            return False
        CLOCK.sleep_until(CLOCK.now_ns() + 5 * MS)
    return True


def still(simulation) -> bool:
    return not any(module.moving for module in simulation.modules.values())


@pytest.fixture
def moving_host(serve):
    simulation, port = serve(StepModule("x"), StepModule("y"))
    host = subprocess.Popen([sys.executable, "-c", HOST, port], stdout=subprocess.PIPE)
    assert host.stdout is not None
    assert select.select([host.stdout], [], [], 20)[0]
    assert host.stdout.readline() == b"moving\n"
    assert wait_for(lambda: all(module.moving for module in simulation.modules.values()))
    yield simulation, host
    if host.poll() is None:
        host.send_signal(signal.SIGCONT)
        host.kill()
    host.wait()
    host.stdout.close()


def test_a_killed_host_leaves_a_machine_at_rest(moving_host) -> None:
    simulation, host = moving_host
    assert not wait_for(lambda: still(simulation), 200), "a living host keeps it moving"
    host.kill()
    assert wait_for(lambda: still(simulation))


def test_a_host_that_hangs_is_stopped_and_fenced_when_it_comes_back(moving_host) -> None:
    simulation, host = moving_host
    host.send_signal(signal.SIGSTOP)
    assert wait_for(lambda: still(simulation))
    host.send_signal(signal.SIGCONT)
    assert wait_for(lambda: host.poll() is not None), "its next write is refused and it ends with that error"
    assert host.returncode == 1
    assert still(simulation)


def test_a_host_in_order_is_never_disturbed(serve) -> None:
    _, port = serve(StepModule("x"), ServoModule("y"))
    link = SupervisedLink(port)
    bus = Bus(link)
    start_up(bus, [ModuleExpectation("pic-step"), ModuleExpectation("pic-servo")])
    with pytest.raises(NmcError, match="no watchdog"):
        link.arm()
    link.watch([Ward(1, "pic-step"), Ward(2, "pic-servo")], (0x81, 0x82), baud=115200)
    step = PicStep(bus, 1)
    step.set_parameters("1x")
    step.stop_motor()
    link.arm()
    link.sleep_until(link.now_ns() + 200 * MS)
    assert bus.exchange(Exchange(1, 0xE)).status is not None
    link.disarm()
    CLOCK.sleep_until(CLOCK.now_ns() + 150 * MS)
    assert bus.exchange(Exchange(1, 0xE)).status is not None
    assert not link.fenced
    link.close()


def test_a_dead_watchdog_is_noticed(serve) -> None:
    _, port = serve(StepModule("x"))
    link = SupervisedLink(port)
    bus = Bus(link)
    start_up(bus, [ModuleExpectation("pic-step")])
    link.watch([Ward(1, "pic-step")], (0x81,), baud=115200)
    link.arm()
    os.kill(link.watchdog_pid, signal.SIGKILL)
    assert wait_for(lambda: not link.watchdog_alive())
    with pytest.raises(NmcError, match="watchdog process has died"):
        bus.exchange(Exchange(1, 0xE))
    link.close()
