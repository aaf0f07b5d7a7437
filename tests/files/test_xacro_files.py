"""xacro files: recognised wherever an arm is read, expanded only by the command that says so."""

import re
import sys

import pytest
from tests.cli.calling import call
from tests.robots.urdf_arms import CYLINDER, SIX, urdf

from omniservo.errors import InputError
from omniservo.files.xacro_files import expand_xacro
from omniservo.robots import Arm

XACRO = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
MACRO = """<xacro:arg name="width" default=""/><xacro:arg name="tool" default="tool0"/>
<xacro:include filename="$(find {package})/inc/sizes.xacro"/>
<xacro:macro name="tube" params="radius">
<cylinder radius="${{radius * factor}}" length="0.1"/></xacro:macro>"""

TASK = """format: omniservo.task/1
name: hostile
summary: names an arm in xacro
camera: perspective
arm: {model: arm.urdf.xacro, flange_T_camera: {}}
start: {joints: [0, 0, 0, 0, 0, 0]}
target: {tags: {dictionary: tag36h11, panels: [{id: 0, edge: 0.1, center: [0, 0, 0.3]}]}}
teach: {initial_T_goal: {}}
scale: {tags: true}
"""


def package(folder, name="arm_description"):
    """A ROS package with an arm in xacro; its folder is called otherwise, as in a clone."""
    root = folder / "clone_of_it"
    (root / "urdf").mkdir(parents=True)
    (root / "inc").mkdir()
    (root / "package.xml").write_text(f"<package><name>{name}</name></package>")
    (root / "inc" / "sizes.xacro").write_text(
        f'<robot {XACRO}><xacro:property name="factor" value="${{0.02 + 0.02}}"/></robot>'
    )
    text = urdf(SIX, visual='<xacro:tube radius="$(arg width)"/>')
    text = text.replace('"tool0"', '"$(arg tool)"')
    head = f'<robot name="mine" {XACRO}>{MACRO.format(package=name)}'
    text = re.sub("<robot[^>]*>", head, text, count=1)
    (root / "urdf" / "arm.urdf.xacro").write_text(text)
    return root


def test_an_expanded_arm_is_the_arm_that_its_author_meant(capsys, tmp_path):
    file = package(tmp_path) / "urdf" / "arm.urdf.xacro"
    code, _, err = call(
        capsys, "robot", "expand", file, "width:=0.5", "tool:=tip", "--out", tmp_path / "arm.urdf"
    )
    assert (code, err) == (0, "")
    expanded = Arm(tmp_path / "arm.urdf")
    (tmp_path / "same.urdf").write_text(
        urdf(SIX, visual=CYLINDER.replace("0.04", "0.02")).replace("tool0", "tip")
    )
    same = Arm(tmp_path / "same.urdf")
    assert (expanded.name, expanded.flange) == ("mine", "tip")
    assert expanded.joint_names == same.joint_names
    assert [link.shapes for link in expanded.links] == [link.shapes for link in same.links]
    q = [0.1, -0.2, 0.3, 0.4, -0.5, 0.6]
    assert (expanded.base_T_flange(q).as_matrix() == same.base_T_flange(q).as_matrix()).all()


def test_a_file_of_the_working_folder_is_not_taken_for_a_module(tmp_path, monkeypatch):
    file = package(tmp_path) / "urdf" / "arm.urdf.xacro"
    (tmp_path / "json.py").write_text("raise RuntimeError('not yours')")
    monkeypatch.chdir(tmp_path)
    assert "0.04" in expand_xacro(file, {"width": "1"})


def test_a_mesh_that_was_found_stays_in_its_package(tmp_path):
    root = package(tmp_path)
    file = root / "urdf" / "arm.urdf.xacro"
    mesh = '<mesh filename="file://$(find arm_description)/meshes/link.stl"/>'
    file.write_text(file.read_text().replace('<xacro:tube radius="$(arg width)"/>', mesh))
    text = expand_xacro(file, {"width": "1"})
    assert 'filename="package://arm_description/meshes/link.stl"' in text
    assert str(tmp_path) not in text.partition("<robot")[2]


def test_a_package_is_found_where_it_is_said_to_be_or_where_ros_has_it(tmp_path, monkeypatch):
    root = package(tmp_path)
    moved = tmp_path / "elsewhere" / "arm.urdf.xacro"
    moved.parent.mkdir()
    (root / "urdf" / "arm.urdf.xacro").rename(moved)
    arguments = {"width": "1"}
    with pytest.raises(
        InputError, match="package 'arm_description': not among .*: --package arm_description="
    ):
        expand_xacro(moved, arguments)
    assert "<link" in expand_xacro(moved, arguments, {"arm_description": root})
    monkeypatch.setenv("ROS_PACKAGE_PATH", f"/nowhere:{root}")
    assert "<link" in expand_xacro(moved, arguments)


def test_nothing_of_a_xacro_file_is_evaluated_where_it_is_only_read(capsys, tmp_path):
    """Neither an arm's reader nor a task asks xacro, whose expressions can reach everything of Python."""
    mark = tmp_path / "reached"
    reach = f"python.vars(python.type)['__subclasses__'](xacro)[0]('{mark}', 'w')"
    (tmp_path / "arm.urdf.xacro").write_text(
        f'<robot name="arm" {XACRO}><xacro:arg name="size" default=""/><link name="${{{reach}}}"/></robot>'
    )
    (tmp_path / "task.yaml").write_text(TASK)
    wanted = "a xacro file, to be expanded first, which evaluates its expressions: omniservo robot expand .*"
    for command in (
        ["robot", "show", tmp_path / "arm.urdf.xacro"],
        ["run", tmp_path / "task.yaml", "--quiet"],
    ):
        code, out, err = call(capsys, *command)
        assert (code, out, len(err.splitlines())) == (2, "", 1)
        assert re.search(wanted + "size:=… --out arm.urdf$", err.strip())
    assert not mark.exists()


BAD = {
    "no argument": (
        {},
        None,
        "when evaluating expression 'radius * factor'; when instantiating macro: tube (",
    ),
    "a misspelt argument": (
        {"width": "1", "tol": "hand"},
        None,
        "argument 'tol': the file has none of this name; legal: width, tool; did you mean 'tool'?",
    ),
    "an endless macro": (
        {"width": "1"},
        '<xacro:macro name="m" params=""><xacro:m/></xacro:macro><xacro:m/>',
        "xacro cannot expand it: ",
    ),
    "a huge number": ({"width": "${len('a' * 10**11)}"}, None, "xacro cannot expand it: "),
    "an unknown package": (
        {"width": "1"},
        '<xacro:include filename="$(find nowhere)/a.xacro"/>',
        "package 'nowhere': not among",
    ),
    "not xml": ({"width": "1"}, "<", "xacro cannot expand it: "),
}


@pytest.mark.parametrize("fault", BAD)
def test_what_cannot_be_expanded_is_one_message_and_no_file(capsys, tmp_path, fault):
    arguments, extra, wanted = BAD[fault]
    file = package(tmp_path) / "urdf" / "arm.urdf.xacro"
    if extra is not None:
        file.write_text(file.read_text().replace("</robot>", extra + "</robot>"))
    stated = [f"{name}:={value}" for name, value in arguments.items()]
    code, out, err = call(capsys, "robot", "expand", file, *stated, "--out", tmp_path / "arm.urdf")
    assert (code, out, len(err.splitlines())) == (2, "", 1)
    assert wanted in err
    assert not (tmp_path / "arm.urdf").exists()


@pytest.mark.parametrize("given", ["width", ":=3"])
def test_an_argument_without_a_value_is_refused(capsys, tmp_path, given):
    file = package(tmp_path) / "urdf" / "arm.urdf.xacro"
    code, _, err = call(capsys, "robot", "expand", file, given, "--out", tmp_path / "arm.urdf")
    assert code == 2
    assert f"ARGUMENTS: '{given}' given; legal: NAME:=VALUE" in err


def test_without_the_package_the_message_says_how_to_get_it(tmp_path, monkeypatch):
    file = package(tmp_path) / "urdf" / "arm.urdf.xacro"
    monkeypatch.setitem(sys.modules, "xacro", None)
    with pytest.raises(InputError, match="not installed: pip install xacro$"):
        expand_xacro(file)
    with pytest.raises(InputError, match="expressions: pip install xacro, then omniservo robot expand "):
        Arm(file)
