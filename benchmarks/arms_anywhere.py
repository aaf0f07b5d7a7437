"""Random arms that stand anywhere, among bodies of any size: what is certified against true distances.

Run: ``python -m benchmarks.arms_anywhere [--motions 3000]``. Every arm is made up: six or seven joints with
random axes, links of all kinds of shapes, hulls among them, a base up to 10 km from the frame's origin, and a
bracket beside the flange. About it stand a half-space and hulls of 1 mm to 100 km, stated in a camera's frame
as a planning problem states them, each 1 mm to 10 cm from the arm at the start, and balls,
rods and drums. A motion is a path of its joints that is certified; what is proven of it is compared with
distances at many places of it. Half of all motions are shorter than a tenth of a milliradian, so that what is
proven comes close to the distances. They come from another computation: bodies placed by MuJoCo's kinematics,
corners in long double, the nearest points of two convex bodies by non-negative least squares over support
points (SciPy's). A distance below the certified one by more than 10⁻⁸ m is counted.
"""

from __future__ import annotations

import argparse
import math
import tempfile
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from benchmarks.tables import print_table
from scipy.optimize import nnls
from scipy.spatial.transform import RigidTransform, Rotation
from tests.robots.joint_paths import straight_joint_path

from omniservo.geometry.arrays import FloatArray
from omniservo.planning import HalfSpace, Mesh
from omniservo.robots import Arm, ArmBodies, Solid, arm_clearance, load_arm
from omniservo.whole_arm.solids_of import solids_of

TOLERANCE = 1e-8
"""[m]"""

PLACES = 17
"""of a motion at which distances are looked at, and as many about the nearest of them"""

MOTIONS = 4
"""of one arm among one set of bodies"""

_STEPS = 80
_CLOSE = 1e-10
"""of a distance, or [m] for bodies of a metre: the bounds of it meet"""


@dataclass(frozen=True)
class Body:
    """A convex body in the frame of what carries it."""

    kind: str
    size: FloatArray
    pose: RigidTransform
    corners: FloatArray

    def support(self, axes: FloatArray, place: FloatArray, n: FloatArray) -> FloatArray:
        """Return the point (3,) that is farthest along n, the carrier's axes (3, 3) and place (3,) given."""
        own = self.pose.rotation.as_matrix()
        m = own.T @ (axes.T @ n)
        if self.kind == "hull":
            point = self.corners[int(np.argmax(self.corners @ m))]
        elif self.kind == "box":
            point = np.sign(m) * self.size
        elif self.kind == "ellipsoid":
            point = self.size**2 * m / np.linalg.norm(self.size * m)
        elif self.kind == "cylinder":
            across = math.hypot(m[0], m[1]) or 1.0
            point = np.array([*(self.size[0] * m[:2] / across), math.copysign(self.size[1], m[2])])
        else:  # a ball, or a rod with round ends
            point = self.size[0] * m / np.linalg.norm(m)
            if self.kind == "capsule":
                point[2] += math.copysign(self.size[1], m[2])
        return place + axes @ (own @ point + self.pose.translation)

    @property
    def radius(self) -> float:
        """Of a ball about the carrier's origin that holds it [m]."""
        far = np.linalg.norm(self.corners, axis=1).max() if len(self.corners) else self.size.sum() * 1.5
        return float(np.linalg.norm(self.pose.translation) + far)


Placed = tuple[Body, FloatArray, FloatArray]
"""a body, and axes (3, 3) and place (3,) of what carries it"""


def distance(one: Placed, other: Placed, enough: float) -> float:
    """Return the distance of two bodies [m], 0 where they touch; ∞ where it is more than enough."""
    n = other[2] - one[2] + 1e-9
    points = np.zeros((0, 3))
    for _ in range(_STEPS):
        new = other[0].support(*other[1:], -n) - one[0].support(*one[1:], n)
        size = float(np.linalg.norm(n))
        if new @ n / size > enough:
            return math.inf
        if len(points) and size - new @ n / size <= _CLOSE * max(1.0, size):
            break
        points, n = _nearest(np.concatenate([points, new[None]]))
        if np.linalg.norm(n) < 1e-10:
            return 0.0
    return float(np.linalg.norm(n))


def _nearest(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return those points (k, 3) whose hull has the point nearest to the origin, and that point."""
    scale = np.abs(points).max()
    weights = nnls(np.vstack([points.T / scale, np.ones(len(points))]), np.array([0.0, 0.0, 0.0, 1.0]))[0]
    kept = points[weights > 0.0]
    edges = (kept[1:] - kept[0]).T
    if not edges.size:
        return kept, kept[0]
    axes, values, _ = np.linalg.svd(edges, full_matrices=False)
    axes = axes[:, values > 1e-12 * values[0]]
    nearest = kept[0] - axes @ (axes.T @ kept[0])
    return kept, nearest - axes @ (axes.T @ nearest)


def _words(values: FloatArray) -> str:
    return " ".join(map(repr, np.asarray(values, dtype=float).tolist()))


def random_body(random: np.random.Generator) -> Body:
    """Return a body of a link: a few centimetres to a decimetre wide."""
    kind = str(random.choice(["sphere", "capsule", "cylinder", "box", "ellipsoid", "hull"]))
    count = {"sphere": 1, "capsule": 2, "cylinder": 2, "box": 3, "ellipsoid": 3, "hull": 0}[kind]
    pose = RigidTransform.from_components(random.uniform(-0.05, 0.05, 3), Rotation.random(rng=random))
    corners = random.uniform(-0.05, 0.05, (random.integers(4, 40), 3)) if kind == "hull" else np.zeros((0, 3))
    return Body(kind, random.uniform(0.01, 0.05, count), pose, corners)


def random_arm(random: np.random.Generator, file: Path) -> tuple[Arm, dict[str, list[Body]]]:
    """Return an arm that is made up, and the bodies of its links by name."""
    joints = int(random.integers(6, 8))
    bodies: dict[str, list[Body]] = {}
    meshes: list[str] = []
    text = '<site name="flange" pos="0 0 0.09"/>'
    for k in range(joints, -1, -1):
        shapes = [random_body(random) for _ in range(random.integers(1, 3))]
        bodies[f"link{k}"] = shapes
        geoms = "".join(_geom(shape, meshes) for shape in shapes)
        place = random.uniform(-1.0, 1.0, 3) * [0.08, 0.08, 0.0] + [0.0, 0.0, random.uniform(0.12, 0.25)]
        if k == 0:
            place = 10.0 ** random.uniform(-1, 4) * Rotation.random(rng=random).apply([0.0, 0.0, 1.0])
        turn = Rotation.random(rng=random).as_quat(scalar_first=True) if k == 0 else [1.0, 0.0, 0.0, 0.0]
        axis = Rotation.random(rng=random).apply([0.0, 0.0, 1.0])
        hinge = f'<joint name="j{k}" axis="{_words(axis)}" range="-2.5 2.5"/>' if k else ""
        text = f'<body name="link{k}" pos="{_words(place)}" quat="{_words(turn)}">{hinge}{geoms}{text}</body>'
    speeds = _words(np.full(joints, 90.0))
    file.write_text(
        f'<mujoco model="arm"><compiler angle="radian"/><default><joint limited="true"/></default>'
        f'<custom><numeric name="joint_speed_deg_s" data="{speeds}"/></custom>'
        f"<asset>{''.join(meshes)}</asset><worldbody>{text}</worldbody></mujoco>"
    )
    return load_arm(file), bodies


def _geom(body: Body, meshes: list[str]) -> str:
    pos, quat = body.pose.translation, body.pose.rotation.as_quat(scalar_first=True)
    where = f'pos="{_words(pos)}" quat="{_words(quat)}"'
    if body.kind != "hull":
        return f'<geom type="{body.kind}" size="{_words(body.size)}" {where}/>'
    meshes.append(f'<mesh name="m{len(meshes)}" vertex="{_words(body.corners.ravel())}"/>')
    return f'<geom type="mesh" mesh="m{len(meshes) - 1}" {where}/>'


class Case:
    """An arm, its bracket and what stands around, as the program has them and as they are."""

    def __init__(self, random: np.random.Generator, file: Path) -> None:
        self.arm, self.bodies_of = random_arm(random, file)
        self.random, self._model = random, self.arm.spec().compile()
        self._data = mujoco.MjData(self._model)
        q = self.q = random.uniform(-1.5, 1.5, self.arm.dof)
        aside = RigidTransform.from_components(random.uniform(-0.08, 0.08, 3), Rotation.random(rng=random))
        bracket = Solid.box("bracket", aside, random.uniform(0.005, 0.06, 3))
        link_T_flange = self.arm.link_T_flange
        box = Body("box", bracket.size, link_T_flange * aside, np.zeros((0, 3)))
        self.bodies_of["camera"] = [box]
        self.place(q)
        self.sides: dict[str, tuple[FloatArray, float]] = {}
        self.kinds: dict[str, str] = {}
        middle = self.carriers["camera"][1]
        base_T_initial = RigidTransform.from_components(middle, Rotation.random(rng=random))
        obstacles = [self._half_space(base_T_initial, 0), self._mesh(base_T_initial, 1)]
        around = [*solids_of(obstacles, base_T_initial), self._drum(middle), self._ball(middle)]
        self.program = ArmBodies(self.arm, mounted=[bracket], surroundings=around)

    def place(self, q: FloatArray) -> None:
        """Bring the links' frames to where they are at joints ``q`` (n,)."""
        self._data.qpos[:] = q
        mujoco.mj_kinematics(self._model, self._data)
        self.carriers = {
            name: (self._data.body(name).xmat.reshape(3, 3), self._data.body(name).xpos)
            for name in self.bodies_of
            if name.startswith("link")
        }
        self.carriers["camera"] = self.carriers[self.arm.flange_link]

    def _lowest(self, n: FloatArray) -> float:
        """Return the least n·x over what moves."""
        moving = [(body, name) for name in self.carriers if name != "link0" for body in self.bodies_of[name]]
        return min(float(n @ body.support(*self.carriers[name], -n)) for body, name in moving)

    def _half_space(self, base_T_initial: RigidTransform, i: int) -> HalfSpace:
        n = Rotation.random(rng=self.random).apply([0.0, 0.0, 1.0])
        offset = self._lowest(n) - self._apart()
        inner = base_T_initial.rotation.inv().apply(n)
        inner /= np.linalg.norm(inner)
        side = HalfSpace(inner, float(offset - n @ base_T_initial.translation))
        matrix = base_T_initial.as_matrix().astype(np.longdouble)
        outer = matrix[:3, :3] @ side.normal.astype(np.longdouble)
        self.sides[f"obstacle {i}"] = outer, side.offset + outer @ matrix[:3, 3]
        self.kinds[f"obstacle {i}"] = "half-space"
        return side

    def _mesh(self, base_T_initial: RigidTransform, i: int) -> Mesh:
        """Return a hull of 1 mm to 100 km, a side or a corner to the arm; one of five is a sheet."""
        random, size = self.random, 10.0 ** self.random.uniform(-3, 5)
        n = Rotation.random(rng=random).apply([0.0, 0.0, 1.0])
        across = np.linalg.svd(n[None])[2][1:]
        flat = random.uniform(-1, 1, (12, 2)) * size
        thick = size * (1e-7 if random.uniform() < 0.2 else random.uniform(0.1, 1.0))
        top = (flat[:, :1] * across[0] + flat[:, 1:] * across[1]) - (random.uniform() < 0.5) * n * (
            random.uniform(0, 0.1, (12, 1)) * thick
        )
        corners = np.concatenate([top, 0.9 * top - thick * n])
        corners += self.carriers["camera"][1] - n * (n @ self.carriers["camera"][1] - self._lowest(n))
        corners -= n * ((corners @ n).max() - self._lowest(n) + self._apart())
        mesh = Mesh(base_T_initial.inv().apply(corners))
        matrix = base_T_initial.as_matrix().astype(np.longdouble)
        true = mesh.vertices.astype(np.longdouble) @ matrix[:3, :3].T + matrix[:3, 3]
        name, middle = f"obstacle {i}", np.array(self.carriers["camera"][1])
        near = np.asarray(true - middle.astype(np.longdouble), dtype=np.float64)
        self._stand(name, Body("hull", np.zeros(0), RigidTransform.identity(), near), middle)
        self.kinds[name] = f"mesh, 1e{math.floor(math.log10(size)):+d} m"
        return mesh

    def _drum(self, middle: FloatArray) -> Solid:
        size = self.random.uniform(0.02, 0.3, 2)
        place = middle + self.random.normal(size=3) * 0.5
        pose = RigidTransform.from_components(place, Rotation.random(rng=self.random))
        kind = "cylinder" if self.random.uniform() < 0.5 else "capsule"
        turned = RigidTransform.from_rotation(pose.rotation)
        self._stand("drum", Body(kind, size, turned, np.zeros((0, 3))), np.array(place))
        self.kinds["drum"] = kind
        return Solid("drum", kind, size, pose)

    def _ball(self, middle: FloatArray) -> Solid:
        place, radius = middle + self.random.normal(size=3) * 0.5, self.random.uniform(0.02, 0.1)
        body = Body("sphere", np.array([radius]), RigidTransform.identity(), np.zeros((0, 3)))
        self._stand("ball", body, np.array(place))
        self.kinds["ball"] = "sphere"
        return Solid.sphere("ball", place, radius)

    def _stand(self, name: str, body: Body, place: FloatArray) -> None:
        self.bodies_of[name] = [body]
        self.standing = {**getattr(self, "standing", {}), name: (np.eye(3), place)}

    def _apart(self) -> float:
        return float(10.0 ** self.random.uniform(-3, -1))

    def pairs(self) -> list[tuple[int, str, Body, str, Body]]:
        """Return the pairs that the program judges, with their bodies."""
        program, found = self.program, []
        owners = [program.owner(g) for g in range(len(program.shapes.kinds))]
        rank = [owners[:g].count(owners[g]) for g in range(len(owners))]
        for pair, (i, j) in enumerate(program.pairs.tolist()):
            one = self.bodies_of[owners[i]][rank[i]] if owners[i] in self.bodies_of else None
            found.append((pair, owners[i], one, owners[j], self.bodies_of[owners[j]][rank[j]]))
        return found

    def left(self, q: FloatArray, asked: FloatArray, within: float) -> tuple[float, str]:
        """Return what is left of what is asked of the pairs at ``q``, if below ``within``, and of which."""
        self.place(q)
        where, least = self.carriers | self.standing, (within, "")
        for pair, first, one, second, other in self._pairs:
            place = where[second]
            if first in self.sides:
                normal, offset = self.sides[first]
                lowest = other.support(*place, -np.asarray(normal, dtype=np.float64))
                gap = float(normal @ lowest.astype(np.longdouble) - offset)
            else:
                apart = np.linalg.norm(where[first][1] - place[1]) - one.radius - other.radius
                if apart - asked[pair] >= least[0]:
                    continue
                gap = distance((one, *where[first]), (other, *place), least[0] + asked[pair])
            if gap - asked[pair] < least[0]:
                least = gap - float(asked[pair]), self.kinds.get(first, "own links")
        return least

    def check(self) -> tuple[str, float, str]:
        """Return the status of a motion, by how much its distance is above what is proven, and of which."""
        self._pairs = self.pairs()
        way = 10.0 ** self.random.uniform(-8.0, -0.4) * self.random.uniform(-1.0, 1.0, self.arm.dof)
        path = straight_joint_path(self.q, self.q + way)
        found = arm_clearance(self.program, path, clearance=0.0, self_clearance=0.0, worst=False)
        if found.status != "clear":
            return found.status, math.nan, ""
        asked, within = self.program.asked(0.0, 0.0), found.proven + 0.002
        places = np.linspace(0.0, 1.0, PLACES)
        values = [self.left(path(w), asked, within) for w in places]
        k = int(np.argmin([value for value, _ in values]))
        around = np.linspace(places[max(k - 1, 0)], places[min(k + 1, PLACES - 1)], PLACES)
        least, kind = min([*values, *(self.left(path(w), asked, within) for w in around)])
        return "clear", least - found.proven, kind or "none near"


def main() -> None:
    """Print how many motions are certified, and how far above it the distances are."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--motions", type=int, default=3000, help="certified ones")
    parser.add_argument("--seed", type=int, default=0, help="of the first arm")
    asked = parser.parse_args()
    statuses: Counter[str] = Counter()
    margins: dict[str, list[float]] = {}
    seed = asked.seed
    with tempfile.TemporaryDirectory() as folder:
        while statuses["clear"] < asked.motions:
            case = Case(np.random.default_rng([24, seed]), Path(folder) / "arm.xml")
            seed += 1
            for _ in range(MOTIONS):
                status, margin, kind = case.check()
                statuses[status] += 1
                if status == "clear":
                    margins.setdefault(kind, []).append(margin)
                if margin < -TOLERANCE:
                    print(f"seed {seed - 1}: {margin:.3g} m, {kind}", flush=True)
    print(f"{seed - asked.seed} arms, {dict(statuses)}\n")
    print_table(
        "| nearest to the arm | certified | below by more than 1e-8 m | least above [m] | median above [m] |",
        (
            f"{kind} | {len(found)} | {sum(m < -TOLERANCE for m in found)} | {min(found):.1e} | "
            f"{np.median(found):.1e}"
            for kind, found in sorted(margins.items())
        ),
    )


if __name__ == "__main__":
    main()
