"""URScript for Universal Robots: a function that is sent to the controller as a whole."""

from __future__ import annotations

from datetime import date

import numpy as np

from planner.exceptions import RequestError
from planner.motion.program_record import FixturedTour, RobotProgram
from planner.output.programs.driving import (
    HOME_TOLERANCE_RAD,
    CameraSignals,
    Drive,
    head_lines,
    plain,
    radians,
    steps_of,
)


def urscript_text(program: RobotProgram, signals: CameraSignals, made: date) -> str:
    """Return the program in URScript; joints in rad, rates of the leading joint in rad/s and rad/s².

    Parameters
    ----------
    program : RobotProgram
        The program.
    signals : CameraSignals
        Trigger and answer of the camera.
    made : date
        The day, for the head.

    Raises
    ------
    RequestError
        If the part lies on a turntable, which URScript does not drive together with the joints.
    """
    if program.turns:
        rule = "must be rapid, krl, ros, csv or json for a part on a turntable"
        hint = "URScript drives no external axis together with the joints"
        raise RequestError.of_rule("format", rule, "'urscript'", hint=hint)
    lines = [
        *(f"# {line}" for line in head_lines(program, made)),
        "# Send it as a whole to port 30002, or load it as a script file and call inspection().",
        "def inspection():",
        f"  home = {_joints(program.home)}",
        *_functions(signals),
    ]
    for tour in program.tours:
        lines += _round(tour, program)
    return "\n".join([*lines, "end"]) + "\n"


def _joints(joints: np.ndarray) -> str:
    return f"[{', '.join(radians(joints))}]"


def _functions(signals: CameraSignals) -> list[str]:
    """Return the local functions: a stop, the check of home, and an image."""
    return [
        "  def stop_with(reason):",
        '    popup(reason, title="inspection", error=True, blocking=True)',
        "    halt",
        "  end",
        "  def check_home(joints):",
        "    actual = get_actual_joint_positions()",
        "    i = 0",
        "    while i < 6:",
        f"      if norm(actual[i] - joints[i]) > {HOME_TOLERANCE_RAD:g}:",
        '        stop_with("The robot must stand at home.")',
        "      end",
        "      i = i + 1",
        "    end",
        "  end",
        "  def take_image(name):",
        f"    sleep({signals.settle_s:g})",
        "    textmsg(name)",
        f"    set_standard_digital_out({signals.trigger_output}, True)",
        f"    sleep({signals.pulse_s:g})",
        f"    set_standard_digital_out({signals.trigger_output}, False)",
        "    waited = 0",
        f"    while not get_standard_digital_in({signals.ready_input}):",
        "      sleep(0.01)",
        "      waited = waited + 0.01",
        f"      if waited > {signals.timeout_s:g}:",
        '        stop_with("The camera does not answer.")',
        "      end",
        "    end",
        "  end",
    ]


def _round(tour: FixturedTour, program: RobotProgram) -> list[str]:
    name = plain(tour.fixturing, 40)
    lines = [
        f"  # fixturing {name}",
        f'  popup("Part in fixturing {name}?", title="inspection", blocking=True)',
        "  check_home(home)",
    ]
    for step in steps_of(tour, program.rates):
        if isinstance(step, Drive):
            rates = f"a={step.lead.acceleration:.6f}, v={step.lead.speed:.6f}"
            lines.append(f"  movej({_joints(step.joints)}, {rates})")
        else:
            lines.append(f'  take_image("{step.image}")')
    return lines
