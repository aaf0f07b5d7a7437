"""Meshes keep the numbers that they are stated with, whatever is done to them on the way."""

import mujoco
import numpy as np
import pytest
from scipy.spatial import ConvexHull
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.robots import ArmBodies, load_arm
from omniservo.robots.arm_files import mesh_assets
from omniservo.robots.collision.exact_vertices import add_hull, corners_of, on_hull
from omniservo.robots.collision.gap_kernels import HULL
from omniservo.robots.collision.gap_search import support


def words(values):
    return " ".join(map(repr, np.asarray(values).ravel().tolist()))


def hull_in_base(arm):
    """Corners (k, 3) of the arm's one hull, in the base frame at q = 0."""
    shapes = ArmBodies(arm).shapes
    shape = int(np.flatnonzero(shapes.kinds == HULL)[0])
    corners = shapes.corners[shapes.firsts[shape] : shapes.firsts[shape + 1]]
    assert shapes.radii[shape] >= np.linalg.norm(corners, axis=1).max()
    return shapes.places[shape] + corners @ shapes.axes[shape].reshape(3, 3).T


def same_points(one, other, within):
    apart = np.linalg.norm(one[:, None] - other[None], axis=2)
    return apart.min(axis=0).max() < within and apart.min(axis=1).max() < within


def arm_with_mesh(tmp_path, mesh, pose):
    """An RX60 with one mesh, an element <mesh> of its file, among the shapes of its base."""
    where = f'pos="{words(pose.translation)}" quat="{words(pose.rotation.as_quat(scalar_first=True))}"'
    text = load_arm("rx60").path.read_text()
    base = '<body name="base" childclass="arm">'
    text = text.replace(base, f'{base}<geom type="mesh" mesh="part" {where}/>')
    file = tmp_path / "arm.xml"
    file.write_text(text.replace("<worldbody>", f"<asset>{mesh}</asset><worldbody>"))
    return load_arm(file)


@pytest.mark.parametrize("seed", range(4))
def test_a_mesh_has_the_vertices_of_its_file_scaled_turned_and_shifted_as_it_says(tmp_path, seed):
    """MJCF: vertices less refpos, turned back by refquat, times scale, then where the shape is."""
    random = np.random.default_rng(seed)
    vertices, scale = random.uniform(-0.3, 0.3, (9, 3)), random.uniform(0.3, 2.0, 3)
    off, turned = random.normal(size=3), Rotation.random(rng=random)
    pose = RigidTransform.from_components(random.normal(size=3), Rotation.random(rng=random))
    mesh = (
        f'<mesh name="part" vertex="{words(vertices)}" scale="{words(scale)}" refpos="{words(off)}" '
        f'refquat="{words(turned.as_quat(scalar_first=True))}"/>'
    )
    expected = pose.apply(turned.inv().apply(vertices - off) * scale)
    corners = expected[ConvexHull(expected).vertices]
    assert same_points(hull_in_base(arm_with_mesh(tmp_path, mesh, pose)), corners, 1e-14)


def test_a_mesh_file_with_all_its_digits_keeps_them(tmp_path):
    """An OBJ, whose numbers are decimal: MuJoCo has them with seven digits."""
    vertices = np.array([[1, 1, 1], [-1, 1, 1], [1, -1, 1], [1, 1, -1], [-1, -1, -1.0]]) / 3.0
    lines = [f"v {words(v)}" for v in vertices] + [
        "f 1 2 3",
        "f 1 3 4",
        "f 1 4 2",
        "f 5 2 3",
        "f 5 3 4",
        "f 5 4 2",
    ]
    (tmp_path / "part.obj").write_text("\n".join(lines))
    pose = RigidTransform.from_translation([0.0, 0.0, 1.0])
    arm = arm_with_mesh(tmp_path, '<mesh name="part" file="part.obj"/>', pose)
    assert same_points(hull_in_base(arm), pose.apply(vertices), 1e-15)


def test_a_mesh_is_read_again_only_where_its_file_has_changed(tmp_path, monkeypatch):
    """A run reads its arm several times; meshes of some makers take seconds."""
    reads = []
    reading = mesh_assets.read_triangles
    monkeypatch.setattr(mesh_assets, "read_triangles", lambda path: reads.append(path) or reading(path))
    corners = np.array([[1, 1, 1], [-1, 1, 1], [1, -1, 1], [1, 1, -1.0]])
    faces = "f 1 2 3\nf 1 3 4\nf 1 4 2\nf 2 3 4\n"
    for times, size in enumerate((1.0, 2.0), 1):
        text = "".join(f"v {words(size * corner)}\n" for corner in corners) + faces
        (tmp_path / "part.obj").write_text(text)
        for _ in range(2):
            arm = arm_with_mesh(tmp_path, '<mesh name="part" file="part.obj"/>', RigidTransform.identity())
            assert same_points(hull_in_base(arm), size * corners, 1e-14)
        assert len(reads) == times


def test_what_is_inside_a_hull_is_dropped_and_nothing_else():
    """Corners, and places on sides and edges, stay: no direction has a farther point than what is kept."""
    random = np.random.default_rng(1)
    cube = np.array(np.meshgrid(*[(-1.0, 0.0, 1.0)] * 3)).reshape(3, -1).T  # with its middle
    flat = np.unique(cube * [1, 1, 0], axis=0)
    for vertices in (cube, random.normal(size=(300, 3)), 1e5 + random.normal(size=(60, 3)), flat):
        kept = on_hull(vertices)
        normals = random.normal(size=(500, 3))
        assert ((kept @ normals.T).max(axis=0) == (vertices @ normals.T).max(axis=0)).all()
    assert len(on_hull(cube)) < len(cube)


def test_a_place_where_several_triangles_meet_is_kept_once():
    """As STL has them: each triangle with corners of its own."""
    block = ConvexHull(np.random.default_rng(3).normal(size=(40, 3)))
    as_stl = block.points[block.simplices].reshape(-1, 3)
    assert len(as_stl) > 4 * len(block.vertices)
    assert len(on_hull(as_stl)) == len(block.vertices)


def test_what_is_only_seen_of_an_arm_is_no_part_of_its_bodies(tmp_path):
    """With a mesh that is seen, whatever its size, the same shapes and pairs as without."""
    text = load_arm("rx60").path.read_text()
    vertices = words(np.random.default_rng(4).normal(size=(30, 3)))
    base = '<body name="base" childclass="arm">'
    seen = f'{base}<geom type="mesh" mesh="part" contype="0" conaffinity="0" group="2"/>'
    file = tmp_path / "arm.xml"
    text = text.replace("<worldbody>", f'<asset><mesh name="part" vertex="{vertices}"/></asset><worldbody>')
    file.write_text(text.replace(base, seen))
    arm, plain = load_arm(file), load_arm("rx60")
    assert arm.spec().compile().nmesh == 1
    bodies, of_plain = ArmBodies(arm), ArmBodies(plain)
    assert bodies.model.nmesh == 0
    assert bodies.pairs.tolist() == of_plain.pairs.tolist()
    q = arm.joint_range.mean(axis=1)
    np.testing.assert_array_equal(bodies.corners(q), of_plain.corners(q))


def test_the_support_of_a_wide_drum_is_its_rim_however_little_it_leans():
    """Radius 10 km: a direction 1e-10 rad from the axis has its farthest point on the rim."""
    for lean in (1e-9, 1e-10, 1e-13):
        n = np.array([np.sin(lean), 0.0, np.cos(lean)])
        x, y, z = support(5, np.array([1e4, 1.0, 0.0]), np.eye(3).ravel(), np.zeros((0, 3)), *n)
        assert (x, y, z) == pytest.approx((1e4, 0.0, 1.0))


def test_mujoco_is_shown_a_mesh_that_it_takes_and_every_vertex_is_in_it():
    plate = np.array([[x, y, z] for x in (0, 1.0) for y in (0, 1.0) for z in (0, 1e-9)])
    for vertices in (plate, 1e-6 * plate + 5.0, plate * [1, 1e-12, 1]):
        spec = mujoco.MjSpec()
        mesh = add_hull(spec, "part", vertices)
        spec.worldbody.add_body(name="body").add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=mesh.name)
        model = spec.compile()
        shown, own = np.array(model.mesh_vert, dtype=float), corners_of(model, 0)
        assert own.shape == vertices.shape
        assert (own.min(axis=0) >= shown.min(axis=0) - 1e-6).all()
        assert (own.max(axis=0) <= shown.max(axis=0) + 1e-6).all()
