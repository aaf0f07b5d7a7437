"""URDF and MJCF files: what is read, what stands in for what, and one clear message for everything else."""

import pickle
import re

import mujoco
import numpy as np
import pytest
import trimesh
from tests.files.test_collada import document
from urdf_arms import CYLINDER, SEVEN, SIX, fingers, urdf, urdf_forward

from omniservo.errors import InputError
from omniservo.robots import Arm, ArmBodies, load_arm, shipped_arms
from omniservo.robots.arm_files import SHOWN_GROUP

MESH = '<mesh filename="{}" scale="0.5 1 1"/>'


def read(folder, text, name="arm.urdf", **options):
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return Arm(path, **options)


def with_ball(path):
    path.parent.mkdir(parents=True, exist_ok=True)
    trimesh.creation.icosphere(1, 0.05).export(path)
    return path


def mjcf(body="", *, joints=6, custom=True, extra="", inner=""):
    """A straight arm of hinges, each a link above the last."""
    speeds = f'<custom><numeric name="joint_speed_deg_s" data="{"90 " * joints}"/></custom>' if custom else ""
    row = "".join(
        f'<body pos="0 0 0.1"><joint axis="{"0 0 1" if k % 2 else "0 1 0"}" range="-120 120"/>'
        '<geom type="capsule" size="0.03 0.03"/>'
        for k in range(joints)
    )
    return (
        f'<mujoco model="straight">{extra}{speeds}<worldbody>{body}{row}{inner}<site name="flange" '
        f'pos="0 0 0.05" euler="0 0 90"/>{"</body>" * joints}</worldbody></mujoco>'
    )


@pytest.mark.parametrize("joints", [SIX, SEVEN], ids=["six", "seven"])
def test_urdf_kinematics_equal_urdfs_own_definition(tmp_path, joints):
    arm = read(tmp_path, urdf(joints))
    for q in np.random.default_rng(0).uniform(*arm.joint_range.T, (50, len(joints))):
        np.testing.assert_allclose(arm.base_T_flange(q).as_matrix(), urdf_forward(joints, q), atol=1e-12)


def test_urdf_limits_stand_as_they_are_written(tmp_path):
    arm = read(tmp_path, urdf())
    np.testing.assert_allclose(arm.joint_range, [row[4:6] for row in SIX])
    np.testing.assert_allclose(arm.joint_speed, [row[6] for row in SIX])
    np.testing.assert_allclose(arm.joint_effort, [row[7] for row in SIX])
    np.testing.assert_allclose(arm.joint_acceleration, arm.joint_speed / 0.25)
    assert any("accelerations are not stated" in notice for notice in arm.notices)
    assert arm.joint_names == tuple(row[0] for row in SIX)
    assert arm.name == "oblique"


def test_fixed_frames_are_kept_and_can_be_the_flange(tmp_path):
    arm = read(tmp_path, urdf())
    assert arm.flange == arm.flange_link == "tool0"
    other = read(tmp_path, urdf(), flange="turn_link")
    q = 0.1 * np.arange(6)
    apart = other.base_T_flange(q).inv() * arm.base_T_flange(q)
    np.testing.assert_allclose(apart.translation, [0, 0, 0.05], atol=1e-12)
    with pytest.raises(InputError, match=r"flange 'lift_link': carried by 2 joints \(pan, lift\); .*tool0"):
        read(tmp_path, urdf(), flange="lift_link")


@pytest.mark.parametrize("ending", ["stl", "obj"])
@pytest.mark.parametrize("place", ["arm_description/meshes", "ws/src/arm_description/meshes", "ws/urdf"])
def test_meshes_are_found_in_the_package_or_beside_the_file(tmp_path, ending, place):
    """The package lies above the file, or beside a folder above it, or the path is a plain one."""
    with_ball(tmp_path / place / f"ball.{ending}")
    where = {"arm_description/meshes": "arm_description/urdf/arm.urdf"}.get(place, "ws/urdf/arm.urdf")
    place = place if "description" in place else ""
    named = f"package://arm_description/meshes/ball.{ending}" if place else f"ball.{ending}"
    if place.startswith("ws"):
        where = "ws/src/other/urdf/arm.urdf"
    arm = read(tmp_path, urdf(visual=MESH.format(named), collision=MESH.format(named)), where)
    shapes = [shape for link in arm.links for shape in link.shapes]
    assert [shape.kind for shape in shapes] == ["mesh"] * 7
    assert sorted(shapes[0].extents) == pytest.approx([0.05, 0.1, 0.1], rel=0.1)


def test_collada_meshes_are_seen_and_touched(tmp_path):
    (tmp_path / "part.dae").write_text(document())
    arm = read(tmp_path, urdf(visual=MESH.format("part.dae"), collision=MESH.format("part.dae")))
    assert [shape.kind for link in arm.links for shape in link.shapes] == ["mesh"] * 7
    assert not any("left out" in notice for notice in arm.notices)


def test_meshes_may_lie_beside_the_folder_of_the_file(tmp_path):
    with_ball(tmp_path / "meshes" / "ball.stl")
    mesh = MESH.format("../meshes/ball.stl")
    arm = read(tmp_path, urdf(visual=mesh, collision=mesh), "urdf/arm.urdf")
    assert [shape.kind for link in arm.links for shape in link.shapes] == ["mesh"] * 7


@pytest.mark.parametrize(("variable", "share"), [("ROS_PACKAGE_PATH", ""), ("AMENT_PREFIX_PATH", "share")])
def test_meshes_are_found_in_the_packages_that_ros_is_set_up_with(tmp_path, monkeypatch, variable, share):
    with_ball(tmp_path / "opt" / share / "arm_description" / "meshes" / "ball.stl")
    mesh = MESH.format("package://arm_description/meshes/ball.stl")
    text = urdf(visual=mesh, collision=mesh)
    for name in ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(InputError, match="nor in ROS_PACKAGE_PATH or AMENT_PREFIX_PATH; say where"):
        read(tmp_path, text, "home/arm.urdf")
    monkeypatch.setenv(variable, f"/nowhere:relative:{tmp_path / 'opt'}")
    arm = read(tmp_path, text, "home/arm.urdf")
    assert [shape.kind for link in arm.links for shape in link.shapes] == ["mesh"] * 7


@pytest.mark.parametrize("place", ["urdf", "meshes"])
def test_meshes_named_as_files_are_read_where_plain_paths_may_lead(tmp_path, place):
    named = tmp_path / "linked" / place / "a ball.stl"
    with_ball(tmp_path / "robot" / place / "a ball.stl")
    (tmp_path / "linked").symlink_to(tmp_path / "robot")
    mesh = MESH.format(named.as_uri())
    assert "file:///" in mesh
    assert "%20" in mesh
    arm = read(tmp_path, urdf(visual=mesh, collision=mesh), "robot/urdf/arm.urdf")
    assert [shape.kind for link in arm.links for shape in link.shapes] == ["mesh"] * 7


def test_a_link_whose_only_picture_is_not_read_is_refused(tmp_path):
    text = re.sub(r"<collision>.*?</collision>", "", urdf(), count=1, flags=re.DOTALL)
    text = text.replace(CYLINDER, MESH.format("fancy.ply"), 1)
    with pytest.raises(InputError, match="link 'base_link': visual: mesh 'fancy.ply' given; legal: .stl"):
        read(tmp_path, text)


@pytest.mark.parametrize(
    ("mesh", "why"),
    [
        ("package://not_there/fancy.ply", "legal: .stl, .obj, .dae"),
        ("package://not_there/arm.stl", "--package not_there=FOLDER"),
        ("gone.stl", "no such file in"),
    ],
)
def test_pictures_that_cannot_be_had_are_left_out_with_a_notice(tmp_path, mesh, why):
    arm = read(tmp_path, urdf(visual=MESH.format(mesh)))
    notice = next(notice for notice in arm.notices if "pictures of links left out" in notice)
    assert mesh.rsplit("/", 1)[-1] in notice
    assert why in notice
    assert [shape.kind for link in arm.links for shape in link.shapes] == ["cylinder"] * 7


def test_pictures_of_no_size_and_second_materials_are_left_out(tmp_path):
    text = urdf().replace(CYLINDER, '<box size="0 0 0"/>', 1)
    text = text.replace("</material>", '</material><material name="blue"/>')
    arm = read(tmp_path, text)
    assert [shape.kind for link in arm.links for shape in link.shapes] == ["cylinder"] * 7
    with pytest.raises(InputError, match="link 'base_link': box: size: 0 given"):
        read(tmp_path, urdf().replace(CYLINDER, '<box size="0 1 0"/>', 1))


@pytest.mark.parametrize(
    "inertia", ["0 0 0.002 0.0115 0 0.0085", "0 0 0 0 0 0", "-1 0 0 1 0 1", "1 0 0 1 0 1e-16"]
)
def test_an_inertia_that_no_body_has_is_that_of_the_link_s_shapes(tmp_path, inertia):
    """The first is cuRobo's of a Panda's base; MuJoCo refuses them, and kinematics do not need them."""
    parts = zip(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), inertia.split(), strict=True)
    stated = " ".join(f'{name}="{value}"' for name, value in parts)
    arm = read(tmp_path, re.sub("<inertia .*?/>", f"<inertia {stated}/>", urdf(), count=3))
    np.testing.assert_array_equal(arm.chain.tool, read(tmp_path, urdf()).chain.tool)


def test_blanks_before_the_xml_declaration_do_not_move_the_lines(tmp_path):
    assert read(tmp_path, " \n\n" + urdf()).name == "oblique"
    with pytest.raises(InputError, match="line 7: link 'base_link': inertia: ixx"):
        read(tmp_path, " \n\n" + urdf().replace('ixx="0.01"', 'ixx="odd"', 1))


def test_an_mjcf_without_speeds_moves_slowly_and_says_so(tmp_path):
    arm = read(tmp_path, mjcf(custom=False))
    assert np.allclose(arm.joint_speed, np.radians(30.0))
    assert any("taken: 30 deg/s each" in notice and "joint_speed_deg_s" in notice for notice in arm.notices)


@pytest.mark.parametrize("unit", ["", '<compiler angle="radian"/>'])
def test_hinges_of_an_mjcf_without_a_range_are_continuous_joints(tmp_path, unit):
    arm = read(tmp_path, mjcf(extra=unit).replace('range="-120 120"', "", 1).replace("-120 120", "-2 2"))
    np.testing.assert_allclose(arm.joint_range[0], [-2.0 * np.pi, 2.0 * np.pi])
    np.testing.assert_allclose(arm.joint_range[1], np.array([-2.0, 2.0]) * (1.0 if unit else np.pi / 180))
    assert any("continuous joints, taken as -360 … 360 deg: joint 1" in notice for notice in arm.notices)


def test_links_without_collision_shapes_are_touched_by_their_pictures(tmp_path):
    text = re.sub(r"<collision>.*?</collision>", "", urdf(), flags=re.DOTALL)
    arm = read(tmp_path, text)
    assert [len(link.shapes) for link in arm.links] == [1] * 7 + [0]
    assert any("touched by what is seen of them" in notice for notice in arm.notices)


def test_seen_is_the_picture_and_touched_the_collision_shape(tmp_path):
    arm = read(tmp_path, urdf(visual='<box size="0.1 0.1 0.1"/>'))
    model = arm.spec().compile()
    boxes = model.geom_type == mujoco.mjtGeom.mjGEOM_BOX
    assert (model.geom_group[boxes] == SHOWN_GROUP).all()
    assert (model.geom_group[~boxes] != SHOWN_GROUP).all()
    assert not model.geom_contype[boxes].any()
    np.testing.assert_allclose(model.geom_rgba[boxes], [[0.9, 0.4, 0.1, 1.0]] * 7, atol=1e-6)


def test_links_called_like_the_simulators_bodies_get_another_name(tmp_path):
    text = urdf().replace('"pan_link"', '"camera"').replace('"lift_link"', '"floor"')
    names = [link.name for link in read(tmp_path, text).links]
    assert "camera" not in names
    assert "floor" not in names


@pytest.mark.parametrize("name", ["base_link", "pan_link"])
def test_a_link_called_world_is_a_link_like_any_other(tmp_path, name):
    """Its shapes are named, drawn, touched and kept off others, its joint's bearing left out."""
    text = re.sub("<collision>.*?</collision>", "", urdf(), count=name == "base_link", flags=re.DOTALL)
    same = read(tmp_path, text)
    called = read(tmp_path, text.replace(f'"{name}"', '"world"'))
    assert [link.shapes for link in called.links] == [link.shapes for link in same.links]
    assert [notice.replace("world link", name) for notice in called.notices] == list(same.notices)
    np.testing.assert_array_equal(called.chain.axes, same.chain.axes)
    np.testing.assert_array_equal(ArmBodies(called).pairs, ArmBodies(same).pairs)


@pytest.mark.parametrize("name", ["tool0", "camera"])
def test_an_arm_is_read_again_from_anywhere_with_the_flange_that_it_has(tmp_path, monkeypatch, name):
    """By another process, and by who slows it down; a link called camera gets another name."""
    (tmp_path / "arm.urdf").write_text(urdf().replace('"tool0"', f'"{name}"'))
    monkeypatch.chdir(tmp_path)
    arm = Arm("arm.urdf")
    monkeypatch.chdir(tmp_path.parent)
    for again in (arm.slowed(0.5), pickle.loads(pickle.dumps(arm))):  # noqa: S301
        assert (again.flange, again.notices) == (arm.flange, arm.notices)
        assert again.base_T_flange(np.ones(6)).as_matrix() == pytest.approx(
            arm.base_T_flange(np.ones(6)).as_matrix()
        )


def test_mjcf_without_names_and_drives_is_an_arm(tmp_path):
    arm = read(tmp_path, mjcf(), "arm.xml")
    assert len(set(arm.joint_names)) == 6
    assert arm.flange == "flange"
    np.testing.assert_allclose(arm.base_T_flange(np.zeros(6)).translation, [0, 0, 0.65], atol=1e-12)
    turned = arm.base_T_flange(np.zeros(6)).rotation.as_euler("xyz", degrees=True)
    np.testing.assert_allclose(turned, [0, 0, 90], atol=1e-9)
    assert any("stiff ones are put in" in notice for notice in arm.notices)


@pytest.mark.parametrize(
    "default",
    ['ctrllimited="true" ctrlrange="-0.8 0.8" gear="2"', 'forcelimited="true"'],
    ids=["clamped", "without a range of forces"],
)
def test_drives_that_are_put_in_take_no_defaults_of_the_file(tmp_path, default):
    """An arm of motors with such defaults was held within 0.8 rad, or refused by MuJoCo."""
    plain = read(tmp_path, mjcf(), "arm.xml").spec().compile()
    arm = read(tmp_path, mjcf(extra=f"<default><general {default}/></default>"), "arm.xml")
    model = arm.spec().compile()
    for name in ("ctrllimited", "forcelimited", "gear", "gainprm", "biasprm"):
        np.testing.assert_array_equal(getattr(model, f"actuator_{name}"), getattr(plain, f"actuator_{name}"))


def test_mjcf_includes_inside_the_folder_are_read(tmp_path):
    whole = mjcf()
    inner = whole[whole.index("<custom>") : whole.index("<worldbody>")]
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "speeds.xml").write_text(f"<mujocoinclude>{inner}</mujocoinclude>")
    arm = read(tmp_path, whole.replace(inner, '<include file="parts/speeds.xml"/>'), "arm.xml")
    np.testing.assert_allclose(arm.joint_speed, np.deg2rad([90] * 6))


def test_what_is_wrong_in_an_included_file_names_that_file_and_its_line(tmp_path):
    (tmp_path / "part.xml").write_text('<mujocoinclude>\n\n<numeric name="a" data="1 nan"/></mujocoinclude>')
    with pytest.raises(InputError, match=r"part.xml: line 3: numeric 'a': data: 'nan' given"):
        read(tmp_path, mjcf(extra='<custom><include file="part.xml"/></custom>'), "arm.xml")


def test_mjcf_scenes_beside_the_arm_s_folder_include_it(tmp_path):
    (tmp_path / "arm").mkdir()
    (tmp_path / "arm" / "arm.xml").write_text(mjcf())
    (tmp_path / "scenes").mkdir()
    scene = '<mujoco><include file="../arm/arm.xml"/></mujoco>'
    assert read(tmp_path / "scenes", scene, "scene.xml").dof == 6


def test_an_arm_without_shapes_says_that_it_touches_nothing(tmp_path):
    bare = re.sub(r"<(visual|collision)>.*?</\1>", "", urdf(), flags=re.DOTALL)
    said = "no link has a shape: nothing of the arm can be touched"
    assert any(said in notice for notice in read(tmp_path, bare).notices)
    assert not any(said in notice for notice in read(tmp_path, urdf()).notices)


def test_a_spring_that_follows_a_joint_of_the_arm_is_refused_with_the_way_on(tmp_path):
    spring = (
        '<link name="spring"/><joint name="spring" type="revolute"><parent link="pan_link"/>'
        '<child link="spring"/><limit lower="-1" upper="1" velocity="1" effort="1"/>'
        '<mimic joint="lift"/></joint>'
    )
    with pytest.raises(
        InputError, match="joint 'spring': .* follows 'lift', .* may be deleted from the file"
    ):
        read(tmp_path, urdf(extra=spring), flange="tool0")


def test_mjcf_meshes_lie_in_its_mesh_folder_and_what_is_no_arm_is_left_out(tmp_path):
    with_ball(tmp_path / "assets" / "ball.stl")
    extra = (
        '<compiler meshdir="assets"/><option timestep="5"/><size memory="900G"/><asset>'
        '<mesh file="ball.stl"/><texture name="t" type="2d" file="/etc/passwd"/>'
        '<material name="m" texture="t" rgba="1 0 0 1"/></asset>'
    )
    body = '<light/><camera/><geom type="plane" size="1 1 1"/><frame><geom size="0.3"/></frame>'
    text = mjcf(body, extra=extra, inner='<geom type="mesh" mesh="ball" material="m"/>')
    arm = read(tmp_path, text, "arm.xml")
    assert [shape.kind for shape in arm.links[-1].shapes] == ["capsule", "mesh"]
    assert any("shapes of the world itself left out: 2" in notice for notice in arm.notices)
    model = arm.spec().compile()
    np.testing.assert_allclose(model.geom_rgba[-1], [1, 0, 0, 1])


def test_a_mocap_target_of_a_scene_is_no_part_of_the_arm(tmp_path):
    target = (
        '<body name="target" mocap="true" pos="0 0.3 0.3"><geom type="box" size=".05 .05 .05"/>'
        '<site name="grasp"/></body>'
    )
    extra = (
        '<contact><exclude body1="target" body2="world"/></contact>'
        '<equality><weld site1="grasp" site2="flange"/></equality>'
    )
    arm = read(tmp_path, mjcf(target, extra=extra), "arm.xml")
    assert "mocap bodies left out: target; they do not belong to the arm" in arm.notices
    plain = read(tmp_path, mjcf(), "arm.xml")
    assert [link.name for link in arm.links] == [link.name for link in plain.links]
    assert arm.flange == "flange"


@pytest.mark.parametrize("joint", ['<joint type="free"/>', "<freejoint/>", '<freejoint name="loose"/>'])
def test_what_lies_loose_in_a_scene_stays_where_it_is(tmp_path, joint):
    cube = f'<body name="cube" pos="0.4 0.1 0.05">{joint}<geom type="box" size=".03 .03 .03"/></body>'
    arm = read(tmp_path, mjcf(cube), "arm.xml")
    assert arm.dof == 6
    (seen,) = (link for link in arm.links if link.name == "cube")
    assert seen.joint == ""
    assert any("held still with what they carry" in notice for notice in arm.notices)


BOMB = '<!DOCTYPE r [<!ENTITY a "ha"><!ENTITY b "&a;&a;">]>\n'
OUTSIDE = '<!DOCTYPE r [<!ENTITY x SYSTEM "file:///etc/passwd">]>\n'
LIMIT = '<limit lower="-2.9" upper="2.9" velocity="2.0" effort="120"/>'
SECOND = (
    '<link name="odd"/><joint name="side" type="{}"><parent link="pan_link"/><child link="odd"/>{}</joint>'
)


def soft(low, high):
    """The text of an arm whose pan, −2.9 … 2.9 rad, has soft limits."""
    stated = f'<safety_controller k_velocity="10" {low} {high}/>'
    return urdf().replace('<child link="pan_link"/>', f'<child link="pan_link"/>{stated}')


@pytest.mark.parametrize(
    ("low", "high", "wanted"),
    [
        ('soft_lower_limit="-1.5"', 'soft_upper_limit="2.5"', (-1.5, 2.5)),
        ('soft_lower_limit="-3.1"', 'soft_upper_limit="2.5"', (-2.9, 2.5)),
        ('soft_lower_limit="-3.1"', 'soft_upper_limit="3.1"', (-2.9, 2.9)),
        ("", 'soft_upper_limit="2.5"', (-2.9, 2.5)),
        ("", "", (-2.9, 2.9)),
    ],
)
def test_the_soft_limits_of_a_urdf_narrow_its_ranges(tmp_path, low, high, wanted):
    arm = read(tmp_path, soft(low, high))
    np.testing.assert_array_equal(arm.joint_range[0], wanted)
    np.testing.assert_array_equal(arm.joint_range[1:], [row[4:6] for row in SIX[1:]])
    narrowed = [notice for notice in arm.notices if "<safety_controller>: pan" in notice]
    assert bool(narrowed) == (wanted != (-2.9, 2.9))


@pytest.mark.parametrize(("low", "high"), [(0, 0), (1, -1), (3, 4), ("x", 1)])
def test_soft_limits_that_leave_nothing_of_a_range_are_refused(tmp_path, low, high):
    text = soft(f'soft_lower_limit="{low}"', f'soft_upper_limit="{high}"')
    with pytest.raises(InputError, match="line .*joint 'pan': safety_controller: .*soft_lower_limit.*legal"):
        read(tmp_path, text)


def test_more_whole_turns_than_branches_can_be_held_are_refused(tmp_path):
    wide = mjcf().replace('range="-120 120"', 'range="-5000 5000"')
    with pytest.raises(InputError, match="ranges hold one posture in .* ways, by whole turns; legal: 78125"):
        read(tmp_path, wide, "arm.xml")
    narrow = read(tmp_path, wide.replace("5000", "720"), "arm.xml")
    assert narrow.joint_range.max() == pytest.approx(4 * np.pi)


def test_what_mujoco_warns_of_in_a_file_is_neither_printed_nor_logged(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    read(tmp_path, mjcf().replace('size="0.03 0.03"', 'size="0.2 0.2" solref="-1 0.5"'), "arm.xml")
    assert [path.name for path in tmp_path.iterdir()] == ["arm.xml"]
    assert capfd.readouterr().err == ""


BAD_URDF = {
    "bomb": (lambda text: text.replace("<robot", BOMB + "<robot", 1), "line 2: document types"),
    "outside": (lambda text: text.replace("<robot", OUTSIDE + "<robot", 1), "line 2: document types"),
    "not xml": (lambda text: text[:-20], "not XML"),
    "xacro": (
        lambda text: "<robot><xacro:arm/></robot>",
        "a xacro file, to be expanded first, which evaluates its expressions: omniservo robot expand ",
    ),
    "no limits": (lambda text: text.replace(LIMIT, ""), "joint 'pan': no <limit>; legal: <limit lower="),
    "no speed": (lambda text: text.replace('velocity="2.0"', "", 1), "joint 'pan': limit: velocity: missing"),
    "no room": (lambda text: text.replace('"-2.9"', '"2.9"'), "lower 2.9, upper 2.9; legal: lower < upper"),
    "no motion": (
        lambda text: text.replace('velocity="2.0"', 'velocity="0"', 1),
        "joint 'pan': limit: velocity: 0 given; greater than 0",
    ),
    "word": (lambda text: text.replace('"-2.9"', '"minus"'), "'minus' given; legal: numbers"),
    "NaN": (lambda text: text.replace('"-2.9"', '"nan"'), "every number must be finite"),
    "huge number": (lambda text: text.replace('"0.05 0 0.15"', '"1e9 0 0"'), "at most 1e\\+06 is legal"),
    "mimic": (
        lambda text: text.replace(LIMIT, LIMIT + '<mimic joint="lift"/>'),
        r"joint 'pan': a <mimic> joint follows another, behind no joint; legal: 6 or 7",
    ),
    "follows the arm": (
        lambda text: text.replace(
            "</robot>", SECOND.format("revolute", LIMIT + '<mimic joint="lift"/>') + "</robot>"
        ),
        r"joint 'lift': other joints follow it \(<mimic>\), behind 1 joint \(pan\); legal: 6 or 7",
    ),
    "follow each other": (
        lambda text: text.replace(
            "</robot>", fingers(mimic='<mimic joint="slide_b"/>').replace("tool0", "turn_link") + "</robot>"
        ),
        "joint 'slide_b': <mimic> joints follow each other in a ring",
    ),
    "follows nothing": (
        lambda text: text.replace("</robot>", fingers(mimic='<mimic joint="gone"/>') + "</robot>"),
        "joint 'slide_b': mimic: joint 'gone': no such joint that moves",
    ),
    "continuous without speed": (
        lambda text: text.replace('"pan" type="revolute"', '"pan" type="continuous"').replace(LIMIT, ""),
        "joint 'pan': no <limit>; legal: <limit lower=",
    ),
    "prismatic": (
        lambda text: text.replace('"pan" type="revolute"', '"pan" type="prismatic"'),
        r"joint 'pan': type 'prismatic' does not turn, behind no joint; legal: 6 or 7",
    ),
    "planar": (
        lambda text: text.replace('"pan" type="revolute"', '"pan" type="planar"'),
        "joint 'pan': type 'planar' given; legal: fixed, revolute, continuous, prismatic",
    ),
    "five": (
        lambda text: text.replace('"pan" type="revolute"', '"pan" type="fixed"'),
        r"5 joints \(lift, elbow, .*\); legal: 6 or 7 in a row",
    ),
    "five and a gripper": (
        lambda text: text.replace('"turn"', '"gripper"'),
        r"joint 'gripper': taken for a gripper's by its name, behind 5 joints \(pan, .*, pitch\)",
    ),
    "eight": (
        lambda text: urdf((*SEVEN, ("last", *SIX[-1][1:]))),
        r"8 joints \(pan, .*, last\); legal: 6 or 7 in a row. A flange says where .*: pitch_link",
    ),
    "branch": (
        lambda text: text.replace("tool0", "palm").replace(
            "</robot>", SECOND.format("revolute", LIMIT) + "</robot>"
        ),
        "joint 'side': moves beside joint 'lift'; legal: one .* after the other, or a flange .*: turn_link",
    ),
    "two bases": (lambda text: text.replace("</robot>", '<link name="odd"/></robot>'), "'base_link', 'odd'"),
    "loop": (
        lambda text: text.replace('<parent link="base_link"/>', '<parent link="turn_link"/>'),
        "joint 'turn': part of a loop; legal: a tree of links",
    ),
    "two parents": (
        lambda text: text.replace(
            "</robot>",
            SECOND.format("fixed", "").replace('child link="odd"', 'child link="tool0"') + "</robot>",
        ),
        "joint 'side': link 'tool0' hangs on joint 'tool_joint' already",
    ),
    "no such link": (lambda text: text.replace('child link="tool0"', 'child link="t"'), "child 't': no such"),
    "name twice": (lambda text: text.replace('joint name="lift"', 'joint name="pan"'), "given twice"),
    "flat axis": (lambda text: text.replace('xyz="0 1 0"', 'xyz="0 0 0"'), "axis: 0 0 0 given"),
    "no shape": (lambda text: text.replace(CYLINDER, "", 1), "0 shapes in <geometry>"),
    "odd shape": (lambda text: text.replace(CYLINDER, "<cone/>", 1), "<cone> given; legal: box, cylinder"),
    "thin": (lambda text: text.replace('radius="0.04"', 'radius="0"', 1), "radius: 0 given; greater than 0"),
    "lost mesh": (
        lambda text: text.replace(CYLINDER, MESH.format("gone.stl")),
        "link 'base_link': collision: mesh 'gone.stl': no such file in ",
    ),
    "lost package": (
        lambda text: text.replace(CYLINDER, MESH.format("package://nowhere/m.stl")),
        "package 'nowhere': not among the 6 folders above the file nor beside them",
    ),
    "lost in package": (
        lambda text: text.replace(CYLINDER, MESH.format("package://arm_box/m.stl")),
        "mesh: 'm.stl': no such file in the package .*arm_box",
    ),
    "out of the package": (
        lambda text: text.replace(CYLINDER, MESH.format("package://arm_box/../m.stl")),
        "legal: a relative path inside",
    ),
    "out of the folder": (
        lambda text: text.replace(CYLINDER, MESH.format("../../m.stl")),
        "'../m.stl' given; legal: a relative path inside the file's folder",
    ),
    "absolute": (lambda text: text.replace(CYLINDER, MESH.format("/m.stl")), "legal: a relative path"),
    "from the net": (
        lambda text: text.replace(CYLINDER, MESH.format("http://x/m.stl")),
        "legal: a path inside the file's folder, or package://NAME/path",
    ),
    "a file elsewhere": (
        lambda text: text.replace(CYLINDER, MESH.format("file:///etc/m.stl")),
        "mesh 'file:///etc/m.stl' given; a file:///… is read inside .*package://NAME/path",
    ),
    "a file by no path": (
        lambda text: text.replace(CYLINDER, MESH.format("file://a%00/m.stl")),
        "mesh 'file://a%00/m.stl' given; a file:///… is read inside ",
    ),
    "a file without a root": (
        lambda text: text.replace(CYLINDER, MESH.format("file://home/flat.stl")),
        "mesh 'file://home/flat.stl': no such file; legal: file:///FOLDER/FILE",
    ),
    "touched picture": (
        lambda text: text.replace(CYLINDER, MESH.format("m.ply")),
        "collision: mesh 'm.ply' given; legal: .stl, .obj, .dae",
    ),
    "no mesh in it": (
        lambda text: text.replace(CYLINDER, MESH.format("text.stl")),
        "mesh .*text.stl: no triangles in it",
    ),
    "flat mesh": (lambda text: text.replace(CYLINDER, MESH.format("flat.stl")), "flat.stl: flat; legal"),
    "deep": (lambda text: "<a>" * 110 + "</a>" * 110, "nested deeper than 100"),
    "other root": (lambda text: "<sdf/>", "root element 'sdf' given; legal: <robot>"),
}

BAD_MJCF = {
    "bomb": (BOMB + mjcf(), "line 1: document types"),
    "five": (mjcf(joints=5), "5 numbers; legal: 6 or 7"),
    "more joints than speeds": (
        mjcf().replace('<joint axis="0 1 0"', '<joint axis="1 0 0" range="0 1"/><joint axis="0 1 0"', 1),
        "6 joint speeds; the arm has 7 joints",
    ),
    "slide": (
        mjcf().replace("<joint ", '<joint type="slide" ', 1),
        "type 'slide' does not turn",
    ),
    "branch": (
        mjcf(joints=5)
        .replace("90 " * 5, "90 " * 6)
        .replace(
            "</worldbody>",
            '<body><joint range="0 1"/><geom size="0.1"/></body></worldbody>',
        ),
        "joint 'joint 6': moves beside joint 'joint 1'; legal: one joint after the other, or a flange",
    ),
    "include outside": (
        mjcf(extra='<include file="../../other.xml"/>'),
        "'../other.xml' given; legal: a relative",
    ),
    "include absolute": (
        mjcf(extra='<include file="/etc/passwd"/>'),
        "'/etc/passwd' given; legal: a relative",
    ),
    "include lost": (mjcf(extra='<include file="gone.xml"/>'), "'gone.xml': no such file in"),
    "include itself": (mjcf(extra='<include file="arm.xml"/>'), "'arm.xml' is included twice"),
    "mesh outside": (
        mjcf(extra='<compiler meshdir="/etc"/><asset><mesh file="m.stl"/></asset>'),
        "legal: a relative path inside",
    ),
    "mesh of another kind": (mjcf(extra='<asset><mesh file="m.msh"/></asset>'), "legal: .stl, .obj"),
    "height field": (mjcf(extra='<asset><hfield file="h.png"/></asset>'), "<hfield> in <asset>; legal"),
    "replicate": (
        mjcf('<replicate count="1000000000"><geom size="1"/></replicate>'),
        "<replicate> in the tree",
    ),
    "plugin": (mjcf(extra='<extension><plugin plugin="x"/></extension>'), "<extension> in <mujoco>; legal"),
    "coupled": (
        mjcf('<body name="post"/>', extra='<equality><weld body1="post" body2="palm"/></equality>').replace(
            '<site name="flange"', '<body name="palm"/><site name="flange"'
        ),
        "<equality> given; legal: joints of the arm that move by themselves",
    ),
    "NaN": (
        mjcf().replace('pos="0 0 0.1"', 'pos="0 nan 0"', 1),
        "body: pos: 'nan' given; legal: numbers up to",
    ),
    "huge number": (
        mjcf().replace('pos="0 0 0.1"', 'pos="0 0 1e308"', 1),
        "'1e308' given; legal: numbers up to",
    ),
    "nonsense": (mjcf().replace('pos="0 0 0.1"', 'pos="here"', 1), "MuJoCo cannot read it: XML Error"),
}


@pytest.fixture
def folder(tmp_path):
    """A place with a package that is empty, and meshes that are none."""
    home = tmp_path / "home"
    (home / "arm_box").mkdir(parents=True)
    (home / "text.stl").write_text("solid of words")
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
    trimesh.Trimesh(corners, [[0, 1, 2], [1, 3, 2]]).export(home / "flat.stl")
    return home


@pytest.mark.parametrize("fault", BAD_URDF)
def test_bad_urdf_is_one_clear_message(folder, fault):
    change, message = BAD_URDF[fault]
    text = change(urdf())
    assert text != urdf()
    with pytest.raises(InputError, match=message) as raised:
        read(folder, text)
    assert str(folder / "arm.urdf") in str(raised.value)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("fault", BAD_MJCF)
def test_bad_mjcf_is_one_clear_message(folder, fault):
    text, message = BAD_MJCF[fault]
    with pytest.raises(InputError, match=message) as raised:
        read(folder, text, "arm.xml")
    assert str(folder) in str(raised.value)
    assert "\n" not in str(raised.value)


def test_huge_files_are_refused_before_they_are_read(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_bytes(b"<robot>" + b" " * 2**23)
    with pytest.raises(InputError, match=r"8388615 bytes; at most 4194304 are read"):
        Arm(path)
    path.write_text("<robot>" + "<link/>" * 60_000 + "</robot>")
    with pytest.raises(InputError, match="more than 50000 elements"):
        Arm(path)
    links = "".join(f'<link name="l{k}"/>' for k in range(600))
    path.write_text(f"<robot>{links}</robot>")
    with pytest.raises(InputError, match="600 links, 0 joints; legal: at most 500"):
        Arm(path)


def test_a_name_that_is_no_arm_is_told_the_shipped_ones():
    with pytest.raises(InputError, match=f"neither a file nor one of the shipped arms: {shipped_arms()[0]}"):
        load_arm("rx61")
