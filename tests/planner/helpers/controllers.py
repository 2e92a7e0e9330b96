"""Small interpreters of URScript, RAPID, KRL and FANUC's programs, with a clock and signals.

They know the statements that programs of inspections use, and share nothing with what writes these programs. Any other
statement is an error.
"""

import math
import re
from dataclasses import dataclass, field

POPUPS_BEFORE_STOP = 3


class Stopped(Exception):
    """The program has stopped."""


@dataclass
class World:
    """A robot cell with a camera, in seconds.

    ``camera(t)`` gives the level of its answer t seconds after the trigger rose; ``at_start`` is the level before.
    """

    camera: object
    at_start: bool = False
    now: float = 0.0
    outputs: dict = field(default_factory=dict)
    raised_at: float | None = None
    pulses: list = field(default_factory=list)
    pulse_ends: float | None = None
    said: list = field(default_factory=list)
    moves: list = field(default_factory=list)
    images: list = field(default_factory=list)
    position: list = field(default_factory=list)

    def sleep(self, seconds):
        self.now += seconds
        if self.pulse_ends is not None and self.now >= self.pulse_ends:
            self.pulse_ends = None
            self.set(next(iter(self.outputs)), False)

    def set(self, number, level):
        before = self.outputs.get(number, False)
        self.outputs[number] = level
        if level and not before:
            self.raised_at = self.now
        if before and not level:
            self.pulses.append(self.now - self.raised_at)

    def answer(self, number=None):
        if self.raised_at is None:
            return self.at_start
        return bool(self.camera(self.now - self.raised_at))

    def ask(self, words):
        self.said.append(words)
        if len(self.said) > POPUPS_BEFORE_STOP:
            raise Stopped

    def finish_pulse(self):
        """Let a pulse end that runs beside the program."""
        if self.pulse_ends is not None:
            self.pulses.append(self.pulse_ends - self.raised_at)
            self.pulse_ends = None

    def wait_for(self, level, most):
        """Wait for a level; return whether it was too late."""
        end = self.now + most
        while self.answer() is not level:
            if self.now > end:
                return True
            self.sleep(0.001)
        return False

    def pulse(self, number, seconds):
        self.set(number, True)
        self.pulse_ends = self.now + seconds


def _run(lines, world):
    source = "\n".join(lines)
    names = {"world": world, "norm": abs, "True": True, "False": False}
    exec(compile(source, "controller", "exec"), names)
    return names


_UR_CALLS = {
    "sleep": "world.sleep",
    "textmsg": "world.images.append",
    "get_actual_joint_positions": "world.position.copy",
}


def run_urscript(text, world):
    """Run a script: blocks end with ``end``, all else is as in Python."""
    lines = []
    depth = 0
    for raw in text.splitlines():
        line = raw.strip()
        if not line or line.startswith("#"):
            continue
        if line == "end":
            depth -= 1
            continue
        for name, call in _UR_CALLS.items():
            line = re.sub(rf"\b{name}\(", f"{call}(", line)
        line = re.sub(r"\bset_standard_digital_out\(", "world.set(", line)
        line = re.sub(r"\bget_standard_digital_in\(", "world.answer(", line)
        line = re.sub(r"^movej\((.*?), a=.*\)$", r"world.moves.append(\1)", line)
        if match := re.match(r'popup\("(.*?)".*\)$', line):
            known = "Part in fixturing" in line or "not at home" in line
            line = f"world.images.append('') if {known} else world.ask({match[1]!r})"
        lines.append("    " * depth + line)
        if line.endswith(":"):
            assert re.match(r"(def|while|if) ", line), line
            depth += 1
    assert depth == 0
    _run([*lines, "inspection()"], world)


def _python_of(condition):
    """Return a condition of RAPID or KRL in Python."""
    words = re.sub(r"\bNOT\b", "not", condition)
    words = re.sub(r"\bAND\b", "and", words)
    words = re.sub(r"\bOR\b", "or", words)
    words = re.sub(r"\bTRUE\b", "True", words)
    words = re.sub(r"\bFALSE\b", "False", words)
    words = words.replace("<>", "!=")
    return re.sub(r"(?<![<>=!:])=(?!=)", "==", words)


def rapid_procedure(text, name):
    """Return the statements of a procedure of RAPID."""
    return re.search(rf"PROC {name}\(.*?\)\n(.*?)\n\s*ENDPROC", text, re.DOTALL)[1].splitlines()


def run_rapid_image(text, world, answer="resRetry"):
    """Run the procedure of RAPID that takes an image."""
    lines = ["resRetry = 'resRetry'", "resCancel = 'resCancel'", "name = 'image'", "answer = ''"]
    depth = 0
    for raw in rapid_procedure(text, "TakeImage"):
        line = raw.strip().removesuffix(";")
        indent = "    " * depth
        if match := re.match(r"VAR (?:bool|btnres) (\w+)(?::=(\w+))?$", line):
            lines.append(f"{indent}{match[1]} = {_python_of(match[2] or 'FALSE')}")
        elif match := re.match(r"WaitTime\\InPos,(.*)$", line):
            lines.append(f"{indent}world.sleep({match[1]})")
        elif line == "TPWrite name":
            lines.append(f"{indent}world.images.append(name)")
        elif match := re.match(r"(WHILE|IF|ELSEIF) (.*) (?:DO|THEN)$", line):
            word = {"WHILE": "while", "IF": "if", "ELSEIF": "elif"}[match[1]]
            depth -= match[1] == "ELSEIF"
            lines.append(f"{'    ' * depth}{word} {_python_of(match[2])}:")
            depth += 1
        elif line in ("ENDWHILE", "ENDIF"):
            depth -= 1
        elif match := re.match(r"WaitDI diCamera,([01])\\MaxTime:=(.*)\\TimeFlag:=(\w+)$", line):
            lines.append(f"{indent}{match[3]} = world.wait_for({match[1] == '1'}, {match[2]})")
        elif match := re.match(r"PulseDO\\PLength:=(.*),doCamera$", line):
            lines.append(f"{indent}world.pulse(3, {match[1]})")
        elif match := re.match(r'UIMsgBox\\Header:=name,"(.*)"\\Buttons:=btnRetryCancel', line):
            lines.append(f"{indent}world.ask({match[1]!r})")
            lines.append(f"{indent}answer = {answer!r}")
        elif line == "EXIT":
            lines.append(f"{indent}raise Stopped")
        else:
            raise AssertionError(line)
    assert depth == 0
    try:
        _run(["from controllers import Stopped", *lines], world)
    finally:
        world.finish_pulse()


def run_krl_image(text, world):
    """Run the subprogram of KRL that takes an image; a halt is started again."""
    body = re.search(r"^DEF take_image\( \)\n(.*?)\nEND$", text, re.DOTALL | re.MULTILINE)[1]
    lines = []
    depth = 0
    comment = ""
    for raw in body.splitlines():
        line = raw.strip()
        indent = "    " * depth
        line = re.sub(r"\$IN\[(\d+)\]", r"world.answer(\1)", line)
        if line.startswith(";"):
            comment = line
        elif re.match(r"(INT|BOOL) \w+$", line):
            continue
        elif match := re.match(r"WAIT SEC (.*)$", line):
            lines.append(f"{indent}world.sleep({match[1]})")
        elif match := re.match(r"(WHILE|IF) (.*?)(?: THEN)?$", line):
            assert (match[1] == "IF") is line.endswith(" THEN")
            lines.append(f"{indent}{match[1].lower()} {_python_of(match[2])}:")
            depth += 1
        elif line in ("ENDWHILE", "ENDIF"):
            depth -= 1
        elif match := re.match(r"\$OUT\[(\d+)\]=(TRUE|FALSE)$", line):
            lines.append(f"{indent}world.set({match[1]}, {_python_of(match[2])})")
        elif line == "HALT":
            lines.append(f"{indent}world.ask({comment!r})")
        elif match := re.match(r"(\w+)=([\w+]+)$", line):
            lines.append(f"{indent}{match[1]} = {_python_of(match[2])}")
        else:
            raise AssertionError(line)
    assert depth == 0
    _run(lines, world)


# of a remark, and of a message on FANUC's pendant
REMARK = 32
MESSAGE = 24
NUMBER = r"\(?(-?\d+(?:\.\d+)?)\)?"


def fanuc_statements(text):
    """Return the statements of a program of FANUC; their numbers count up, and the head says how many there are."""
    body = re.search(r"^/MN\n(.*?)\n/POS$", text, re.DOTALL | re.MULTILINE)[1].splitlines()
    statements = []
    for number, line in enumerate(body, start=1):
        match = re.fullmatch(r" *(\d+):(  |(?=J ))(\S.*) ;", line)
        assert match, line
        assert int(match[1]) == number
        statements.append(match[3])
    assert f"LINE_COUNT\t= {len(statements)};" in text
    return statements


def fanuc_positions(text):
    """Return the axes of its positions by number, degrees."""
    positions = {}
    listed = text[text.index("\n/POS\n") : text.index("\n/END")]
    for match in re.finditer(
        r"^P\[(\d+)\]\{\n   GP1:\n\tUF : 0, UT : 0,\t\n(.*?)\n\};", listed, re.DOTALL | re.M
    ):
        axes = re.findall(r"([JE]\d)= *(-?\d+\.\d{3}) deg", match[2])
        assert [name for name, _ in axes] == ["J1", "J2", "J3", "J4", "J5", "J6", "E1"][: len(axes)]
        positions[int(match[1])] = [float(angle) for _, angle in axes]
    return positions


def run_fanuc(statements, positions, world):
    """Run statements; a pause is started again."""
    labels = {
        match[1]: k for k, s in enumerate(statements) if (match := re.fullmatch(r"LBL\[(\d+)\]", s))
    }
    registers = {}
    stands = []
    timeout = math.nan
    remark = message = ""
    k = 0
    while k < len(statements):
        line = statements[k]
        k += 1
        if line.startswith("!"):
            assert len(line) <= REMARK + 1, line
            remark = f"{remark} {line[1:].strip()}".strip()
            continue
        if match := re.fullmatch(r"MESSAGE\[([A-Za-z ]+)\]", line):
            message = match[1]
            assert len(message) <= MESSAGE
            continue
        if line == "PAUSE":
            if message in ("Put in the part", "Not at home"):
                world.images.append(f"({message})")
            else:
                world.ask(f"{message}: {remark}")
        elif match := re.fullmatch(r"JMP LBL\[(\d+)\]", line):
            k = labels[match[1]]
        elif match := re.fullmatch(r"\$WAITTMOUT=(\d+)", line):
            timeout = int(match[1]) / 100
            assert int(match[1]) <= 32767
        elif match := re.fullmatch(r"WAIT +(\d*\.\d\d)\(sec\)", line):
            world.sleep(float(match[1]))
        elif match := re.fullmatch(r"WAIT DI\[\d+\]=(ON|OFF) TIMEOUT,LBL\[(\d+)\]", line):
            if world.wait_for(match[1] == "ON", timeout):
                k = labels[match[2]]
        elif match := re.fullmatch(r"DO\[(\d+)\]=PULSE,(\d+\.\d)sec", line):
            world.pulse(int(match[1]), float(match[2]))
        elif match := re.fullmatch(r"PR\[\d+\]=JPOS", line):
            stands = [math.degrees(angle) for angle in world.position]
        elif match := re.fullmatch(r"R\[(\d+)\]=PR\[\d+,(\d)\]", line):
            registers[match[1]] = stands[int(match[2]) - 1]
        elif match := re.fullmatch(rf"IF R\[(\d+)\]([<>]){NUMBER},JMP LBL\[(\d+)\]", line):
            value = registers[match[1]]
            if value > float(match[3]) if match[2] == ">" else value < float(match[3]):
                k = labels[match[4]]
        elif match := re.fullmatch(r"J P\[(\d+)\] (\d+%|\d+msec|\d+\.\dsec) FINE", line):
            world.position = [math.radians(angle) for angle in positions[int(match[1])]]
            world.moves.append(world.position)
            if match[2].endswith("msec"):
                world.sleep(int(match[2].removesuffix("msec")) / 1000)
        elif not re.fullmatch(r"LBL\[\d+\]|UFRAME_NUM=0|UTOOL_NUM=0", line):
            raise AssertionError(line)
        # a name may be followed by its lamps
        if match := re.fullmatch(r"(setting_\d+(?:_\d+)?\.png)(?:: lamps? [\d, ]+ on)?", remark):
            world.images.append(match[1])
        remark = ""
    world.finish_pulse()


def run_fanuc_image(text, world):
    """Run the statements that take the first image."""
    statements = fanuc_statements(text)
    first = next(
        k
        for k, line in enumerate(statements)
        if line.startswith("! setting_") and line.endswith("png")
    )
    end = next(k for k in range(first, len(statements)) if statements[k].startswith("J "))
    # the time that the program sets at its start
    waits = [line for line in statements if line.startswith("$")]
    try:
        run_fanuc([*waits, *statements[first:end]], {}, world)
    finally:
        world.finish_pulse()
