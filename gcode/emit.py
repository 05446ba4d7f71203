"""The emitter: where program coordinates become canonical commands in absolute machine mm.

It keeps the frame of the moment and the last position, from which it knows whether a move turns rotary axes alone
(whose feed is in degrees, whatever the length unit).
"""

from __future__ import annotations

from typing import Any

from gcode.canon import (
    Arc,
    Command,
    Coolant,
    Feed,
    MoveBlock,
    Nurbs,
    Plane,
    Position,
    Probe,
    Rapid,
    RigidTap,
    Spindle,
    SpindleSynch,
    Text,
    TiltedArc,
)
from gcode.frame import Frame, FrameChange
from gcode.state import State, position_of

PLANE_NAMES: dict[int, Plane] = {170: "XY", 180: "ZX", 190: "YZ"}
PLANE_AXES = {170: (0, 1, 2), 180: (2, 0, 1), 190: (1, 2, 0)}
"""First, second and third axis of a plane, right-handed."""


class Emitter:
    """Collects commands; ``take`` hands them over. ``line`` is the source line of what is emitted next."""

    def __init__(self, state: State) -> None:
        self.state = state
        self.line = 0
        self.frame: Frame = state.frame()
        self.last: Position = self.frame.to_machine(position_of(state.position))
        self._out: list[Command | MoveBlock] = []
        self.held: list[Any] | None = None

    def take(self) -> list[Command | MoveBlock]:
        """The commands since the last call."""
        out = self._out
        self._out = []
        return out

    def command(self, command: Command) -> None:
        """A finished command; it waits if cutter compensation holds moves back."""
        (self._out if self.held is None else self.held).append(command)

    def block(self, block: MoveBlock) -> None:
        """A block of plain moves."""
        self._out.append(block)

    def text(self, function: str) -> None:
        """A canonical function that moves nothing, spelled as it is printed."""
        self.command(Text(self.line, function))

    def comment(self, text: str) -> None:
        """COMMENT("...")."""
        self.text(f'COMMENT("{text}")')

    def frame_change(self, function: str) -> None:
        """A function that changes offsets, units or rotation: the frame is taken anew from the state."""
        self.frame = self.state.frame()
        self.command(FrameChange(self.line, function, self.frame))

    def rapid(self, end: list[float]) -> None:
        """STRAIGHT_TRAVERSE to program coordinates ``end``."""
        target = self.frame.to_machine(position_of(end))
        self.command(Rapid(self.line, target))
        self.last = target

    def feed(self, end: list[float], feed_mm_s: float | None = None) -> None:
        """STRAIGHT_FEED to program coordinates ``end`` at the feed of the state, if none is given."""
        target = self.frame.to_machine(position_of(end))
        self.command(Feed(self.line, target, self.feed_mm_s(target) if feed_mm_s is None else feed_mm_s))
        self.last = target

    def arc(self, end: list[float], center: tuple[float, float], turns: int, feed_mm_s: float | None = None) -> None:
        """ARC_FEED about ``center`` (program coordinates of the plane's first and second axis)."""
        first, second, _ = PLANE_AXES[self.state.plane]
        target = self.frame.to_machine(position_of(end))
        middle = list(end)
        tilted = self.frame.rotation_deg != 0.0 and self.state.plane != 170
        middle[first], middle[second] = center
        at = self.frame.to_machine(position_of(middle))
        plane = PLANE_NAMES[self.state.plane]
        feed = self.path_feed_mm_s() if feed_mm_s is None else feed_mm_s
        if tilted:
            self.command(TiltedArc(self.line, target, at, plane, self.frame.rotation_deg, turns, feed))
        else:
            self.command(Arc(self.line, target, (at[first], at[second]), plane, turns, feed))
        self.last = target

    def probe(self, end: list[float], *, away: bool, required: bool) -> None:
        """STRAIGHT_PROBE towards program coordinates ``end``."""
        target = self.frame.to_machine(position_of(end))
        self.command(Probe(self.line, target, self.feed_mm_s(target), away, required))

    def rigid_tap(self, end: list[float], pitch: float) -> None:
        """RIGID_TAP to ``end`` and back; ``pitch`` in program units per revolution."""
        target = self.frame.to_machine(position_of(end))
        self.command(RigidTap(self.line, target, pitch * self.state.unit_mm))

    def nurbs(self, points: list[tuple[float, float, float]], order: int) -> None:
        """NURBS_FEED through control points (x, y, weight) in program coordinates; the last one is the end."""
        machine_points: list[tuple[float, float, float]] = []
        place = list(self.state.position)
        for x, y, weight in points:
            place[0], place[1] = x, y
            at = self.frame.to_machine(position_of(place))
            machine_points.append((at[0], at[1], weight))
        target = self.frame.to_machine(position_of(place))
        self.command(Nurbs(self.line, target, tuple(machine_points), order, self.path_feed_mm_s()))
        self.last = target

    def synchronise(self, pitch: float | None) -> None:
        """START_SPEED_FEED_SYNCH with ``pitch`` (program units a revolution), or its end."""
        self.command(SpindleSynch(self.line, None if pitch is None else pitch * self.state.unit_mm))

    def spindle(self, spelled: str) -> None:
        """The spindle as the state has it now. Surface speed is S in m/min, or ft/min under G20."""
        state = self.state
        direction = (state.spindle_direction > 0) - (state.spindle_direction < 0)
        if state.spindle_mode == 970:
            self.command(Spindle(self.line, direction, state.spindle_rpm, spelled))  # type: ignore[arg-type]
            return
        surface_mm_s = abs(state.spindle_rpm) * (1000.0 if state.unit_mm == 1.0 else 304.8) / 60.0
        axis_x_mm = self.frame.to_machine((0.0,) * 9)[0]
        self.command(
            Spindle(self.line, direction, 0.0, spelled, surface_mm_s, state.spindle_limit_rpm, axis_x_mm)  # type: ignore[arg-type]
        )

    def coolant(self, spelled: str) -> None:
        """The coolant as the state has it now."""
        self.command(Coolant(self.line, self.state.mist, self.state.flood, spelled))

    def path_feed_mm_s(self) -> float:
        """The feed of the state along a path of lengths, mm/s. Feed per revolution counts with the spindle's speed."""
        state = self.state
        per_minute = state.feed * state.unit_mm
        if state.feed_mode == 950:
            per_minute *= abs(state.spindle_rpm)
        return per_minute / 60.0

    def feed_mm_s(self, target: Position) -> float:
        """The feed of a straight move from the last position to ``target``: mm/s, or deg/s if only rotary axes turn."""
        last = self.last
        if target[:3] != last[:3] or target[6:] != last[6:] or target == last:
            return self.path_feed_mm_s()
        per_minute = self.state.feed
        if self.state.feed_mode == 950:
            per_minute *= abs(self.state.spindle_rpm)
        return per_minute / 60.0
