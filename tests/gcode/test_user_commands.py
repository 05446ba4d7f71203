"""M100 to M199: handed on with P and Q, a synch point, refused by a machine that has no such command."""

from gcode.canon import Feed, UserCommand
from gcode.canontext import canon_lines
from gcode.interp import interpret
from gcode.run import Run
from gcode.setup import Setup
from gcode.synch import Answer, Synch

PROGRAM = "G21 F100\nG1 X1\nM110 P1.5 Q2\nG1 X2\nM2\n"
WITH_M110 = Setup(user_commands=frozenset({110}))


def commands(text, setup=WITH_M110):
    result = interpret(text, setup)
    assert not result.errors
    return [command for command in result.commands if isinstance(command, UserCommand)]


def test_p_and_q_are_handed_on():
    assert commands(PROGRAM) == [UserCommand(3, 110, 1.5, 2.0)]
    assert commands("M110\nM2\n") == [UserCommand(1, 110, None, None)]
    assert [line.split(None, 2)[2] for line in canon_lines(commands(PROGRAM))] == [
        "USER_DEFINED_FUNCTION(110, 1.5000, 2.0000)"
    ]


def test_it_acts_before_the_motion_of_its_line():
    kinds = [type(c).__name__ for c in interpret("F100\nG1 X1 M110\nM2\n", WITH_M110).commands]
    assert kinds.index("UserCommand") < kinds.index("Feed")


def test_the_interpreter_waits_and_takes_the_position_it_is_told():
    events = Run("G21 F100\nG1 X1\nM110\nG91 G1 X2\nM2\n", WITH_M110).events()
    ends, answer, waits = [], None, []
    while True:
        try:
            event = events.send(answer)
        except StopIteration:
            break
        answer = None
        if isinstance(event, Synch):
            waits.append((event.kind, event.line, event.target[0]))
            answer = Answer(position=(5.0,) + (0.0,) * 8)
        elif isinstance(event, Feed):
            ends.append(event.end[0])
    assert waits == [("user", 3, 1.0)]
    assert ends == [1.0, 7.0]


def test_without_a_machine_it_is_warned_of():
    result = interpret(PROGRAM)
    assert [(d.code, d.severity, d.line, d.column) for d in result.diagnostics] == [("GC218", "warning", 3, 1)]


def test_a_machine_without_it_refuses():
    [error] = interpret(PROGRAM, Setup(user_commands=frozenset())).errors
    assert (error.code, error.line, error.column, error.end_column) == ("GC065", 3, 1, 5)
    assert "[user_command.M100]" in error.hint
    [error] = interpret("M111\nM2\n", WITH_M110).errors
    assert "it has M110" in error.hint


def test_compensation_keeps_it_between_its_moves():
    text = "G21 G17 F100\nG41.1 D1\nG1 X5 Y5\nX20\nM110\nY20\nX0\nG40\nG0 X0 Y-5\nM2\n"
    result = interpret(text, WITH_M110)
    assert not result.errors
    lines = [c.line for c in result.commands if isinstance(c, Feed | UserCommand)]
    assert lines == sorted(lines)
    assert 5 in lines
