"""Names and types of RTDE's variables, for a stand-in of the controller (those of software 5.12)."""

from __future__ import annotations

import re

from omniservo.hardware.rtde.packets import NOT_FOUND

_TYPES = {
    "DOUBLE": r"timestamp|actual_execution_time|speed_scaling|target_speed_fraction|actual_momentum|payload|"
    r"actual_main_voltage|actual_robot_voltage|actual_robot_current|tcp_force_scalar|io_current|"
    r"standard_analog_(input|output)[01]|tool_analog_input[01]|tool_(output_current|temperature)",
    "INT32": r"robot_mode|safety_mode|safety_status|tool_output_voltage",
    "UINT32": r"runtime_state|robot_status_bits|safety_status_bits|analog_io_types|tool_mode|"
    r"tool_analog_input_types|script_control_line|(in|out)put_bit_registers(0_to_31|32_to_63)",
    "UINT64": r"actual_digital_(input|output)_bits",
    "UINT8": r"tool_output_mode|tool_digital_output[01]_mode",
    "VECTOR3D": r"actual_tool_accelerometer|elbow_(position|velocity)|payload_cog",
    "VECTOR6D": r"target_(q|qd|qdd|current|moment|TCP_pose|TCP_speed)|joint_(control_output|temperatures)|"
    r"actual_(q|qd|current|current_window|TCP_pose|TCP_speed|TCP_force|joint_voltage)|tcp_offset|"
    r"payload_inertia|ft_raw_wrench",
    "VECTOR6INT32": r"joint_mode",
}

_INPUTS = {
    "DOUBLE": r"speed_slider_fraction|standard_analog_output_[01]",
    "UINT32": r"speed_slider_mask|input_bit_registers(0_to_31|32_to_63)",
    "UINT8": r"(standard|configurable|tool)_digital_output(_mask)?|standard_analog_output_(mask|type)",
    "VECTOR6D": r"external_force_torque",
}

_REGISTERS = {"int": ("INT32", range(48)), "double": ("DOUBLE", range(48)), "bit": ("BOOL", range(64, 128))}


def output_type(name: str) -> str:
    """Return the type of what a controller sends by this name, or NOT_FOUND."""
    return _register_type(name, "input|output") or _type(name, _TYPES)


def input_type(name: str) -> str:
    """Return the type of what a client writes by this name, or NOT_FOUND."""
    return _register_type(name, "input") or _type(name, _INPUTS)


def _register_type(name: str, directions: str) -> str | None:
    found = re.fullmatch(rf"(?:{directions})_(int|double|bit)_register_(\d{{1,3}})", name)
    if found is None:
        return None
    kind, numbers = _REGISTERS[found[1]]
    return kind if int(found[2]) in numbers else NOT_FOUND


def _type(name: str, types: dict[str, str]) -> str:
    return next((kind for kind, names in types.items() if re.fullmatch(names, name)), NOT_FOUND)
