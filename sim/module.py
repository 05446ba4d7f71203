"""What every NMC module does, whatever its type: addresses, groups, chain, checksums, status masks, reset, baud.

Sources: PIC-STEP data sheet section 3 and PIC-SERVO data sheet section 4.1, which describe the same protocol. A type of
module adds its commands (``execute``), its status byte and items, and its manner of timing (``take``).
"""

from __future__ import annotations

from functools import partial

from sim.bus import Bus
from sim.commandline import HEADER
from sim.draws import Draws
from sim.uart import POWER_UP_BRD, chip_baud

RESET_POSITION, SET_ADDRESS, DEFINE_STATUS, READ_STATUS = 0x0, 0x1, 0x2, 0x3
LOAD_TRAJECTORY, START_MOTION, SET_PARAMETERS, STOP_MOTOR = 0x4, 0x5, 0x6, 0x7
SET_OUTPUTS, SET_HOMING, SET_BAUD, CLEAR_BITS = 0x8, 0x9, 0xA, 0xB
SAVE_HOME, RESERVED, NOP, HARD_RESET = 0xC, 0xD, 0xE, 0xF

COMM_ERROR = 0x02


class NmcModule:
    """One module on a bus. ``epoch`` changes whenever what was under way must be forgotten (reset)."""

    type_id = -1
    mask_bits = 0x3F
    name: str

    def __init__(self, name: str, bus: Bus, ppb: int, draws: Draws) -> None:
        self.name = name
        self.bus = bus
        self.world = bus.world
        self.log = bus.log
        self.ppb = ppb
        self.draws = draws
        self.broken = False
        self.alive = False
        self.epoch = 0
        self.home_position = 0
        self._power_up_comms()

    def _power_up_comms(self) -> None:
        """Data sheets: address 0x00, group 0xFF, no leader, ADDR_OUT HIGH, 19200 baud, no status items."""
        self.address = 0x00
        self.group = 0xFF
        self.leader = False
        self.addr_out_low = False
        self.mask = 0x00
        self.brd = POWER_UP_BRD
        self.rx_baud = self.rate(self.brd)
        self.packet_bytes = bytearray()
        self.packet_clean = True
        self.idle = True

    def rate(self, brd: int) -> float:
        """True baud for a divisor."""
        return chip_baud(brd, self.ppb)

    # -- hearing -----------------------------------------------------------------------------------------------------

    def set_alive(self, alive: bool) -> None:
        """ADDR_IN has gone LOW (alive) or HIGH; a half-received packet is forgotten."""
        if alive != self.alive:
            self.bus.command.disturb()
            self.alive = alive
            self._forget_packet()

    def _forget_packet(self) -> None:
        self.packet_bytes.clear()
        self.packet_clean = True
        self.idle = True

    def hear_byte(self, value: int, clean: bool) -> None:
        """One byte of the command line; framing is driven by the length in the command byte alone (no time-out)."""
        got = self.packet_bytes
        if not got:
            if value == HEADER and clean:
                got.append(value)
                self.idle = False
            return
        got.append(value)
        self.packet_clean &= clean
        if len(got) >= 4 and len(got) == 4 + (got[2] >> 4):
            packet = bytes(got)
            good = self.packet_clean and (sum(packet[1:-1]) & 0xFF) == packet[-1]
            self._forget_packet()
            if self.matches(packet[1], packet[2]):
                self.hear_packet(packet[1], packet[2], packet[3:-1], good)

    def matches(self, address: int, command: int) -> bool:
        """Whether a packet with this address is for the module."""
        return address in (self.address, self.group)

    def hear_packet(self, address: int, command: int, data: bytes, good: bool) -> None:
        """A packet for this module is complete."""
        answers = address == self.address or self.leader
        if not answers:
            self.bus.expect_silence()
        if good and address != self.address and (command & 0x0F) == SET_ADDRESS:
            self.violation("X-50", "Set Address to a group: several modules now share one individual address")
        self.take(command & 0x0F, data, good, answers)

    # -- to be supplied by the type of module --------------------------------------------------------------------------

    def take(self, command: int, data: bytes, good: bool, answers: bool) -> None:
        """Deal with a packet in the chip's own time: answer and execute, or execute and answer."""
        raise NotImplementedError

    def status_byte(self) -> int:
        """The status byte without the communications error bit."""
        raise NotImplementedError

    def status_item(self, bit: int) -> bytes:
        """The extra status bytes of one mask bit."""
        raise NotImplementedError

    def execute(self, command: int, data: bytes) -> None:
        """Carry out a command of the type's own."""
        raise NotImplementedError

    def power_up(self) -> None:
        """Bring everything that is not communication to its power-up state."""
        raise NotImplementedError

    def synchronise(self) -> None:
        """Bring the module's own motion to the present time."""

    def halt_dead(self) -> None:
        """The chip has died: nothing drives its motor any more."""

    def drop_reply(self) -> bool:
        """The host has talked: a reply that has not begun is not sent. Returns whether there was one."""
        return False

    # -- answering ---------------------------------------------------------------------------------------------------

    def reply_bytes(self, mask: int, error: bool) -> bytes:
        """Status byte, items of ``mask`` in ascending bit order, checksum."""
        packet = bytearray([(self.status_byte() & ~COMM_ERROR) | (COMM_ERROR if error else 0)])
        bit = 0
        rest = mask & self.mask_bits
        while rest:
            if rest & 1:
                packet += self.status_item(bit)
            rest >>= 1
            bit += 1
        packet.append(sum(packet) & 0xFF)
        return bytes(packet)

    def reply_mask(self, command: int, data: bytes) -> int:
        """Define Status and Read Status answer with their own mask, everything else with the defined one."""
        return data[0] if command in (DEFINE_STATUS, READ_STATUS) and data else self.mask

    # -- commands that all types share -------------------------------------------------------------------------------

    def check_length(self, command: int, data: bytes, wanted: int) -> bool:
        """X-40: too short is not executed, too long is cut; both are logged."""
        if len(data) < wanted:
            self.violation("X-40", f"command 0x{command:X} with {len(data)} of {wanted} data bytes: not executed")
            return False
        if len(data) > wanted:
            self.violation("X-40", f"command 0x{command:X} with {len(data)} data bytes: all after {wanted} ignored")
        return True

    def shared(self, command: int, data: bytes) -> bool:
        """Carry out a shared command; False if it is not one of them."""
        if command == NOP:
            self.check_length(command, data, 0)
        elif command == READ_STATUS:
            if self.check_length(command, data, 1):
                self._check_mask(data[0])
        elif command == DEFINE_STATUS:
            if self.check_length(command, data, 1):
                self._check_mask(data[0])
                self.mask = data[0]
        elif command == SET_ADDRESS:
            if self.check_length(command, data, 2):
                self._set_address(data[0], data[1])
        elif command == SET_BAUD:
            if self.check_length(command, data, 1):
                self._set_baud(data[0])
        elif command == HARD_RESET:
            self.check_length(command, data, 0)
            self.hard_reset()
        else:
            return False
        return True

    def _check_mask(self, mask: int) -> None:
        if mask & ~self.mask_bits & 0xFF:
            self.violation("X-49", f"status items 0x{mask:02X}: bits that this module does not have are ignored")

    def _set_address(self, address: int, group: int) -> None:
        self.address = address
        self.leader = not group & 0x80
        self.group = group | 0x80
        if not self.addr_out_low:
            self.addr_out_low = True
            self.bus.rewire()

    def _set_baud(self, brd: int) -> None:
        self.bus.command.disturb()
        self.brd = brd
        self.rx_baud = self.rate(brd)

    def hard_reset(self) -> None:
        """Power-up state; ADDR_OUT goes HIGH, so everything behind it in the chain falls silent."""
        self.bus.command.disturb()
        self.epoch += 1
        self._power_up_comms()
        self.power_up()
        self.bus.rewire()

    # -- telling -----------------------------------------------------------------------------------------------------

    def violation(self, rule: str, consequence: str) -> None:
        """Log a breach of the data sheet at the present time."""
        self.log.violation(self.world.now_ns, self.name, rule, consequence)

    def incident(self, what: str) -> None:
        """Log something that the chip did on its own account."""
        self.log.incident(self.world.now_ns, self.name, what)

    def zero_bits(self, rule: str, value: int, mask: int) -> None:
        """Log bits that the sheet wants to be zero."""
        if value & mask:
            self.violation(rule, f"byte 0x{value:02X}: bits 0x{mask:02X} should be zero, ignored")

    def later(self, time_ns: int, command: int, data: bytes) -> None:
        """Execute a command at ``time_ns`` unless the module is reset before."""
        self.world.call_at(time_ns, partial(self._if_same_epoch, self.epoch, command, data))

    def _if_same_epoch(self, epoch: int, command: int, data: bytes) -> None:
        if epoch == self.epoch and not self.broken and not self.shared(command, data):
            self.execute(command, data)
