"""URScript for Universal Robots: a function that is sent to the controller as a whole."""

from __future__ import annotations

from datetime import date

import numpy as np

from planner.exceptions import RequestError
from planner.motion.program_record import FixturedTour, RobotProgram
from planner.output.programs.driving import (
    CameraSignals,
    Drive,
    head_lines,
    plain,
    radians,
    rate_text,
    steps_of,
    time_text,
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
        f"  home = {_joints(program.controller.of(program.home))}",
        *_home_function(program),
        *_functions(signals),
    ]
    for tour in program.tours:
        lines += _round(tour, program)
    return "\n".join([*lines, "end"]) + "\n"


def _joints(joints: np.ndarray) -> str:
    return f"[{', '.join(radians(joints))}]"


def _home_function(program: RobotProgram) -> list[str]:
    """Return a function that drives to home: from near it, or where the operator lets it."""
    words = "The robot is not at home. The way there is not checked. Continue only if it is free."
    speed = rate_text(program.start.speed, "speed")
    acceleration = rate_text(float(program.rates.accelerations.min()), "accelerations")
    return [
        "  def go_home(joints):",
        "    actual = get_actual_joint_positions()",
        "    is_far = False",
        "    i = 0",
        "    while i < 6:",
        f"      if norm(actual[i] - joints[i]) > {program.start.tolerance_rad:g}:",
        "        is_far = True",
        "      end",
        "      i = i + 1",
        "    end",
        "    if is_far:",
        f'      popup("{words}", title="inspection", warning=True, blocking=True)',
        "    end",
        f"    movej(joints, a={acceleration}, v={speed})",
        "  end",
    ]


def _functions(signals: CameraSignals) -> list[str]:
    """Return the local functions: a stop, and an image."""
    return [
        "  def stop_with(reason):",
        '    popup(reason, title="inspection", error=True, blocking=True)',
        "    halt",
        "  end",
        "  def take_image(name):",
        f"    sleep({time_text(signals.settle_s)})",
        "    textmsg(name)",
        f"    set_standard_digital_out({signals.trigger_output}, True)",
        f"    sleep({time_text(signals.pulse_s)})",
        f"    set_standard_digital_out({signals.trigger_output}, False)",
        "    waited = 0",
        f"    while not get_standard_digital_in({signals.ready_input}):",
        "      sleep(0.01)",
        "      waited = waited + 0.01",
        f"      if waited > {time_text(signals.timeout_s)}:",
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
        "  go_home(home)",
    ]
    for step in steps_of(tour, program):
        if isinstance(step, Drive):
            acceleration = rate_text(step.lead.acceleration, "accelerations")
            speed = rate_text(step.lead.speed, "speed")
            lines.append(f"  movej({_joints(step.axes)}, a={acceleration}, v={speed})")
        else:
            lines.append(f'  take_image("{step.image}")')
    return lines
