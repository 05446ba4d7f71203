"""Who is on the bus, in which groups, and who answers: the guard in front of every command.

It watches every exchange, keeps one tracker a module, and knows from the addresses alone whether and by whom a
command will be answered (PIC-STEP data sheet sections 3.1 to 3.3).
"""

from __future__ import annotations

from nmc.chips.common import (
    DEFAULT_GROUP,
    GROUP_MIN,
    HARD_RESET,
    LOAD_TRAJECTORY,
    MEMBER_BIT,
    MODULES_MAX,
    READ_STATUS,
    SET_ADDRESS,
    SET_BAUD,
    START_MOTION,
    STOP_MOTOR,
)
from nmc.errors import LocalFault
from nmc.modes import Tracker
from nmc.program import Exchange

_BROADCAST_OK = (SET_BAUD, HARD_RESET)


class Guard:
    """Trackers by address. ``modules`` is for reading; enrol modules with ``enrol``."""

    def __init__(self) -> None:
        self.modules: dict[int, Tracker] = {}
        self._groups: dict[int, tuple[Tracker, ...]] = {}

    def enrol(self, tracker: Tracker) -> None:
        """Begin to watch a module. Raises LocalFault beyond 32 modules."""
        if tracker.address not in self.modules and len(self.modules) >= MODULES_MAX:
            raise LocalFault(f"at most {MODULES_MAX} modules on one network", rule="section 1")
        self.modules[tracker.address] = tracker
        self._regroup()

    def forget_all(self) -> None:
        """The network has been reset: nobody is known any more."""
        self.modules.clear()
        self._groups.clear()

    def members(self, address: int) -> tuple[Tracker, ...]:
        """Modules that execute a command sent to this address."""
        module = self.modules.get(address)
        if module is not None:
            return (module,)
        return self._groups.get(address, ())

    def replier(self, address: int) -> Tracker | None:
        """The module that answers at this address, None if nobody does."""
        module = self.modules.get(address)
        if module is not None:
            return module
        for member in self._groups.get(address, ()):
            if member.leader:
                return member
        return None

    def check(self, exchange: Exchange) -> None:
        """Raise LocalFault if this exchange must not leave now."""
        address, command, data = exchange.address, exchange.command, exchange.data
        for resting in exchange.at_rest:
            if resting in self.modules:
                self.modules[resting].at_rest()
        module = self.modules.get(address)
        if module is not None:
            if command == SET_ADDRESS:
                module.check(command, data)
                self._check_set_address(module, data)
            elif command in _BROADCAST_OK:
                self._check_single(module, command)
            else:
                module.check(command, data, endless=exchange.endless, for_rest=exchange.for_rest)
            return
        if command in _BROADCAST_OK:
            self._check_broadcast(address, command)
            return
        group = self._groups.get(address, ())
        if group and command == SET_ADDRESS:
            raise LocalFault("Set Address to a group would give all members one address", address=address)
        if command in (LOAD_TRAJECTORY, START_MOTION):
            for doubtful in self.modules.values():
                if doubtful.address_unsure:
                    raise doubtful.fault("its group is unknown after a lost Set Address", "3.3")
        for member in group:
            member.check(command, data, endless=exchange.endless, for_rest=exchange.for_rest)

    def _check_set_address(self, module: Tracker, data: bytes) -> None:
        individual, group_byte = data
        other = self.modules.get(individual)
        if other is not None and other is not module:
            raise module.fault(f"address {individual} is taken", "3.2")
        if individual in self._groups and individual >= GROUP_MIN:
            raise module.fault(f"address {individual} is a group's", "3.3")
        if not group_byte & MEMBER_BIT:
            group = group_byte | MEMBER_BIT
            for member in self._groups.get(group, ()):
                if member.leader and member is not module:
                    raise module.fault(f"group {group} already has a leader, module {member.address}", "3.3")

    def _check_single(self, module: Tracker, command: int) -> None:
        if command == SET_BAUD:
            raise module.fault("Set Baud Rate only to a group of all modules without a leader", "5.1 Set Baud Rate")
        if any(other > module.address for other in self.modules):
            raise module.fault("a Hard Reset inside the chain silences the modules behind it", "3.2")

    def _check_broadcast(self, address: int, command: int) -> None:
        if command == SET_BAUD and self.modules:
            group = self._groups.get(address, ())
            if len(group) != len(self.modules) or any(member.leader for member in group):
                raise LocalFault(
                    "Set Baud Rate only to a group of all modules without a leader",
                    address=address,
                    rule="section 5.1 Set Baud Rate",
                )

    def repeatable(self, exchange: Exchange) -> bool:
        """Whether a second sending does no more than the first."""
        members = self.members(exchange.address)
        return bool(members) and all(m.repeatable(exchange.command, exchange.data) for m in members)

    def settle(self, exchange: Exchange, replier: Tracker | None, status: int | None, extra: bytes) -> None:
        """The command was carried out; raises RemoteFault if the answer tells of a fault."""
        address, command, data = exchange.address, exchange.command, exchange.data
        if command == SET_ADDRESS and replier is not None:
            self._readdress(replier, data)
        elif command == HARD_RESET:
            if address == DEFAULT_GROUP or address in self._groups:
                self.forget_all()
            else:
                self.modules.pop(address, None)
            self._regroup()
            return
        for member in self.members(address) if replier is None or replier.address != address else ():
            if member is not replier:
                member.executed(command, data)
        if replier is not None and status is not None:
            replier.answered(command, data, status, extra)
            fault = replier.judge(status)
            stops = command == STOP_MOTOR and len(data) == 1  # with a position it leads the motor (Stop Here)
            if fault is not None and not stops and command != READ_STATUS:
                raise fault

    def lost(self, exchange: Exchange) -> None:
        """Nobody knows whether the command was carried out."""
        for member in self.members(exchange.address):
            member.lost(exchange.command, exchange.data)

    def _readdress(self, module: Tracker, data: bytes) -> None:
        individual, group_byte = data
        if individual != module.address:
            del self.modules[module.address]
            module.address = individual
            self.modules[individual] = module
        module.group = group_byte | MEMBER_BIT
        module.leader = not group_byte & MEMBER_BIT
        module.address_unsure = False
        self._regroup()

    def _regroup(self) -> None:
        groups: dict[int, list[Tracker]] = {}
        for module in self.modules.values():
            groups.setdefault(module.group, []).append(module)
        self._groups = {address: tuple(members) for address, members in groups.items()}
