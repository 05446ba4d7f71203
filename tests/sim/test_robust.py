"""Whatever a host sends, at whatever rate and moment: the simulator never raises, and a reset brings it back."""

import numpy as np
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from sim.faults import Noise, schedule
from sim.rawhost import RawHost, machine, packet
from sim.spec import IoModule, ServoModule, ServoPlant, StepModule, Switch

KINDS = [3, 0, 3, 2]


def mixed_bus(seed, jitter):
    switches = (Switch("limit1", 400, None), Switch("limit2", None, -400), Switch("home", 100, 200))
    modules = [
        StepModule("A", switches=switches, crystal_ppm=80),
        ServoModule("B", switches=switches[:2], plant=ServoPlant(stop_low_counts=-900, stop_high_counts=900)),
        StepModule("C", crystal_ppm=-80),
        IoModule("D"),
    ]
    return machine(modules, seed, jitter)


class AnyHost(RuleBasedStateMachine):
    """A host that obeys no rule."""

    @initialize(seed=st.integers(0, 99), jitter=st.sampled_from([0, 200_000]), noisy=st.booleans())
    def power_up(self, seed, jitter, noisy):
        self.sim, self.host = mixed_bus(seed, jitter)
        self.host.start_up(4)
        if noisy:
            schedule(self.sim, [Noise(lose=0.01, flip=0.01, insert=0.01, seed=seed)])
        self.now = self.sim.world.now_ns

    @rule(
        address=st.sampled_from([0, 1, 2, 3, 4, 0x81, 0xFF, 0xAA]),
        command=st.integers(0, 15),
        data=st.binary(max_size=15),
        wait_us=st.sampled_from([0, 100, 700, 3000, 50_000]),
    )
    def command(self, address, command, data, wait_us):
        self.host.link.write(packet(address, command, data))
        self.host.wait_ms(wait_us / 1000)

    @rule(
        address=st.sampled_from([1, 2, 3, 0x81]),
        control=st.integers(0, 255),
        data=st.binary(min_size=14, max_size=14),
    )
    def well_formed_load(self, address, control, data):
        sizes = [4, 1, 1, 3] if address != 2 else [4, 4, 4, 1]
        size = sum(s for k, s in enumerate(sizes) if control >> k & 1)
        self.host.link.write(packet(address, 4, bytes([control]) + data[:size]))
        self.host.wait_ms(5)

    @rule(data=st.binary(max_size=40))
    def garbage(self, data):
        self.host.link.write(data)

    @rule(baud=st.sampled_from([1200, 9600, 19200, 57600, 115200, 250_000]))
    def change_rate(self, baud):
        self.host.link.set_baud(baud)

    @rule(wait_ms=st.sampled_from([0.01, 1, 30, 1000]))
    def wait(self, wait_ms):
        self.host.wait_ms(wait_ms)
        self.host.link.read(7, self.host.link.now_ns() + 1_000_000)

    @rule(
        pin=st.sampled_from(["estop", "in1", "power", "limit1", "home"]),
        level=st.booleans(),
        volts=st.sampled_from([0.0, 24.0]),
    )
    def outside(self, pin, level, volts):
        self.sim.modules["A"].set_inputs(**{pin: level})
        self.sim.modules["B"].set_supply(volts)

    @invariant()
    def time_goes_on_and_positions_are_32_bit(self):
        if not hasattr(self, "sim"):
            return
        assert self.sim.world.now_ns >= self.now
        self.now = self.sim.world.now_ns
        for name in "ABC":
            assert -0x80000000 <= self.sim.modules[name].position <= 0x7FFFFFFF

    def teardown(self):
        if not hasattr(self, "sim"):
            return
        for bus in self.sim.buses:
            bus.noise = bus.status.noise = None
        self.sim.trace()
        assert found(self.sim, self.host) == KINDS


def found(sim, host: RawHost):
    """Switch the power off and on, then enumerate."""
    host.link.sleep_until(sim.buses[0].command.free_ns + 10_000_000)  # what the host had handed over still leaves
    sim.power_cycle()
    host.link.set_baud(19200)
    host.link.write(bytes(16))
    host.wait_ms(40)
    host.link.flush_input()
    kinds = []
    for address in range(1, 5):
        host.exchange(0, 1, [address, 0xFF])
        host.wait_ms(2)
        kinds.append(host.items(address, 0x20, 2)[0])
    return kinds


AnyHost.TestCase.settings = settings(stateful_step_count=25, suppress_health_check=list(HealthCheck))
test_any_host = AnyHost.TestCase


def test_a_megabyte_of_noise():
    """Random bytes, most of them full of headers, for a minute of bus time."""
    rng = np.random.default_rng(7)
    sim, host = mixed_bus(3, 0)
    host.start_up(4)
    for _ in range(100):
        data = rng.integers(0, 256, 600).astype(np.uint8)
        data[rng.random(600) < 0.1] = 0xAA
        data[rng.random(600) < 0.2] = rng.choice([0x00, 0x01, 0x02, 0x03, 0x04, 0x81])
        host.link.write(data.tobytes())
        host.wait_ms(60)
        host.link.read(1000, host.link.now_ns())
    assert sim.trace().bus_ns.size > 60_000
    assert found(sim, host) == KINDS
