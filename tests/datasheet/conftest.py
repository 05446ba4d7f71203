"""A started-up PIC-STEP or PIC-SERVO whose bytes are recorded, for the tests of the driver."""

from __future__ import annotations

import pytest

from nmc.bus import Bus
from nmc.picservo import Gains, PicServo
from nmc.picstep import PicStep
from nmc.recording_link import HOST, RecordingLink
from nmc.setup import ModuleExpectation, start_up
from sim.build import build
from sim.spec import BusSpec, ServoModule, StepModule, Switch

GAINS = Gains(220, 2640, 150, 4000)


class Rig:
    """One PIC-STEP, started up at 115200 baud, its bytes recorded."""

    def __init__(self, module: StepModule | None = None) -> None:
        self.simulation = build([BusSpec("bus", (module or StepModule("x"),))], 1)
        self.link = RecordingLink(self.simulation.links[0])
        self.bus = Bus(self.link)
        start_up(self.bus, [ModuleExpectation("pic-step")])
        self.step = PicStep(self.bus, 1)

    def ready(self) -> PicStep:
        self.step.set_parameters("2x", minimum_speed=5)
        self.step.stop_motor()
        return self.step

    def last(self) -> bytes:
        """The last packet from its command byte to the end of its data."""
        return [chunk.data for chunk in self.link.chunks if chunk.line == HOST][-1][2:-1]

    def count(self) -> int:
        return sum(chunk.line == HOST for chunk in self.link.chunks)


@pytest.fixture
def rig() -> Rig:
    return Rig()


@pytest.fixture
def homed_rig() -> Rig:
    """A home switch that closes at step 150."""
    return Rig(StepModule("x", switches=(Switch("home", 150, None),)))


@pytest.fixture
def step(rig: Rig) -> PicStep:
    return rig.ready()


class ServoRig:
    """One PIC-SERVO, started up at 115200 baud, its bytes recorded."""

    def __init__(self, module: ServoModule | None = None) -> None:
        self.simulation = build([BusSpec("bus", (module or ServoModule("x"),))], 1)
        self.link = RecordingLink(self.simulation.links[0])
        self.bus = Bus(self.link)
        start_up(self.bus, [ModuleExpectation("pic-servo")])
        self.servo = PicServo(self.bus, 1)

    def ready(self) -> PicServo:
        self.servo.set_gain(GAINS)
        self.servo.stop_motor("abruptly")
        self.servo.clear_sticky_bits()
        return self.servo

    def last(self) -> bytes:
        """The last packet from its command byte to the end of its data."""
        return [chunk.data for chunk in self.link.chunks if chunk.line == HOST][-1][2:-1]

    def count(self) -> int:
        return sum(chunk.line == HOST for chunk in self.link.chunks)


@pytest.fixture
def make_servo_rig() -> type[ServoRig]:
    """For a PIC-SERVO with a description of its own."""
    return ServoRig


@pytest.fixture
def servo_rig() -> ServoRig:
    return ServoRig()


@pytest.fixture
def servo(servo_rig: ServoRig) -> PicServo:
    return servo_rig.ready()
