"""Plan files made by hand, and their true margins by dense sampling with NumPy and SciPy: the reference."""

import copy

import numpy as np
from scipy.spatial.transform import Rotation

FE185 = {
    "model": "unified",
    "fx": 296.9365,
    "fy": 298.4197,
    "cx": 316.8076,
    "cy": 254.9012,
    "skew": 0.0,
    "xi": 1.2910,
    "distortion": [0.0, 0.0, 0.0, 0.0],
    "width": 659,
    "height": 432,
    "max_angle": float(np.radians(92.5)),
    "dead_zone": None,
}


def ridge(center=(0, -0.08, 0.40), step=(0.08, 0.06), depth=0.07):
    """Nine dots on two boards that meet at a ridge, as in the paper's first example."""
    return [
        [
            center[0] + i * step[0],
            center[1] + k * step[1],
            center[2] - abs(i) * depth + 0.004 * (-1) ** (i + k),
        ]
        for i in (-1, 0, 1)
        for k in (-1, 0, 1)
    ]


def problem(**changes):
    """The paper's first example, d = 55 mm."""
    base = {
        "format": "omniservo.problem/1",
        "camera": copy.deepcopy(FE185),
        "points": ridge(),
        "goal": {"translation": [0.0000497, -0.0999782, 0.1999552], "quaternion": [0.0, 0.0, 0.0, 1.0]},
        "obstacles": [
            {"type": "sphere", "center": [-0.01, -0.065, 0.085], "radius": 0.0},
            {"type": "sphere", "center": [-0.005, -0.08, 0.09], "radius": 0.0},
        ],
        "clearance": 0.055,
        "least_distance": 0.02,
        "visibility_margin": 0.0,
        "occlusion": False,
        "degrees": {"rotation": 2, "translation": 2},
    }
    base.update(changes)
    return base


def path(problem, detour=(0.0, 0.0, 0.0), twist=(0.0, 0.0, 0.0, 0.0)):
    """Power-basis rows of t = w·goal + 4w(1−w)·detour and the interpolated quaternion + 4w(1−w)·twist."""
    goal, detour = np.array(problem["goal"]["translation"]), np.array(detour)
    q, twist, start = np.array(problem["goal"]["quaternion"]), np.array(twist), np.array([0.0, 0, 0, 1])
    return {
        "rotation": np.column_stack([-4 * twist, q - start + 4 * twist, start]).tolist(),
        "translation": np.column_stack([-4 * detour, goal + 4 * detour, 0 * goal]).tolist(),
    }


def plan(problem, path, margins=None, status="certified"):
    """The plan file that states these margins: by default the sampled ones, a little lowered."""
    if margins is None:
        margins = {name: m - slack(m) for name, (m, _, _) in true_margins(problem, path).items()}
    units = {"visibility": "px", "dead_zone": "px", "domain": "rad", "rotation": "1"}
    lines = [
        {"name": name, "margin": float(m), "unit": units.get(name.split()[0], "m"), "w": 0.5}
        for name, m in margins.items()
    ]
    return {
        "format": "omniservo.plan/1",
        "problem": problem,
        "status": status,
        "path": path,
        "certificate": {"constraints": lines, "worst": worst(lines)},
        "seconds": 0.001,
    }


def worst(lines):
    """The line of the lengths with the smallest margin."""
    return dict(min((line for line in lines if line["unit"] == "m"), key=lambda line: line["margin"]))


def slack(margin):
    """More than what 20 001 samples can miss on the paths used here."""
    return 1e-6 * (1 + abs(margin))


def camera_points(path, points, w):
    """(samples, points, 3) [m]"""
    t = np.array([np.polyval(row, w) for row in path["translation"]]).T
    q = np.array([np.polyval(row, w) * np.ones_like(w) for row in path["rotation"]]).T
    offsets = np.asarray(points)[None] - t[:, None]
    return np.einsum("kji,knj->kni", Rotation.from_quat(q).as_matrix(), offsets), t, q


@np.errstate(divide="ignore", invalid="ignore")
def project(camera, c):
    """Pixels by the formula, domain or not."""
    rho = np.linalg.norm(c, axis=-1)
    m = c[..., :2] / (c[..., 2] + camera["xi"] * rho)[..., None]
    x, y = m[..., 0], m[..., 1]
    k1, k2, p1, p2 = camera["distortion"]
    s = x * x + y * y
    radial = 1 + k1 * s + k2 * s * s
    x, y = (
        x * radial + 2 * p1 * x * y + p2 * (s + 2 * x * x),
        y * radial + p1 * (s + 2 * y * y) + 2 * p2 * x * y,
    )
    u = camera["fx"] * x + camera["skew"] * y + camera["cx"]
    return np.stack([u, camera["fy"] * y + camera["cy"]], -1), m


def true_margins(problem, path, samples=20_001):
    """Name -> (margin, w, point) over dense samples."""
    w = np.linspace(0, 1, samples)
    c, t, q = camera_points(path, problem["points"], w)
    camera, found = problem["camera"], {}

    def note(name, values):
        k = np.unravel_index(np.argmin(values), values.shape)
        found[name] = (float(values[k]), w[k[0]], None if values.ndim == 1 else int(k[1]))

    for i, o in enumerate(problem.get("obstacles", ())):
        own = o.get("clearance", problem.get("clearance", 0.0))
        seen = t - moved(o, w)
        if o["type"] == "half_space":
            note(f"clearance obstacle {i}", seen @ o["normal"] - o["offset"] - own)
            continue
        apart = np.min([np.linalg.norm(seen - c, axis=1) for c in centers(o)], axis=0)
        note(f"clearance obstacle {i}", apart - o["radius"] - own)
    inside = problem.get("workspace", {})
    for axis, x in enumerate("xyz" if "min" in inside else ""):
        note(f"workspace {x} min", t[:, axis] - inside["min"][axis])
        note(f"workspace {x} max", inside["max"][axis] - t[:, axis])
    for i, side in enumerate(inside.get("half_spaces", ())):
        normal = np.array(side["normal"])
        note(f"workspace half-space {i}", t @ normal / np.linalg.norm(normal) - side["offset"])
    note("rotation", (q * q).sum(1) - 0.01)
    rho = np.linalg.norm(c, axis=-1)
    xi = camera["xi"]
    angle = np.arctan2(np.hypot(c[..., 0], c[..., 1]), c[..., 2])
    note("domain", np.arccos(-xi if xi <= 1 else -1 / xi) - angle)
    inset = problem.get("visibility_margin", 0.0)
    pixels, m = project(camera, c)
    u, v = pixels[..., 0], pixels[..., 1]
    if not any(camera["distortion"]):
        note("visibility left edge", u + 0.5 - inset)
        note("visibility right edge", camera["width"] - 0.5 - u - inset)
        note("visibility top edge", v + 0.5 - inset)
        note("visibility bottom edge", camera["height"] - 0.5 - v - inset)
        if camera["max_angle"] is not None:
            k = [[camera["fx"], camera["skew"]], [0, camera["fy"]]]
            sigma = np.linalg.svd(k, compute_uv=False)[-1]
            r = np.sin(camera["max_angle"]) / (np.cos(camera["max_angle"]) + xi)
            note("visibility max_angle", (r - np.linalg.norm(m, axis=-1)) * sigma - inset)
    if camera["dead_zone"] is not None:
        zone = camera["dead_zone"]
        note("dead_zone", np.linalg.norm(pixels - zone["center"], axis=-1) - zone["radius"] - inset)
    for i, corners in enumerate(camera.get("mask", ())):
        note(f"visibility mask {i}", _beyond(pixels, np.array(corners, dtype=float)) - inset)
    note("least_distance", rho - problem.get("least_distance", 1e-3))
    if problem.get("occlusion", False):
        for i, o in enumerate(problem["obstacles"]):
            if o.get("radius", 0) > 0:
                centre = moved(o, w)[:, None]
                sights = [_to_segments(t, problem["points"], c + centre) for c in centers(o)]
                note(f"occlusion obstacle {i}", np.min(sights, axis=0) - o["radius"])
    return found


def centers(obstacle):
    """Of a sphere or a cloud."""
    return obstacle["points"] if obstacle["type"] == "cloud" else [obstacle["center"]]


def moved(obstacle, w):
    """(samples, 3) [m]"""
    return np.array([np.polyval(row, w) + 0 * w for row in obstacle.get("motion", [[0.0]] * 3)]).T


def _beyond(pixels, corners):
    """How far pixels lie beyond the edge of a convex polygon that they are farthest beyond [px]."""
    edges = np.roll(corners, -1, axis=0) - corners
    turn = np.sign(edges[0, 0] * edges[1, 1] - edges[0, 1] * edges[1, 0])
    normals = turn * np.column_stack([edges[:, 1], -edges[:, 0]])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    return np.max([(pixels - c) @ n for c, n in zip(corners, normals, strict=True)], axis=0)


def _to_segments(t, points, centers):
    along = np.asarray(points)[None] - t[:, None]
    start = centers - t[:, None]
    share = np.clip((start * along).sum(-1) / (along * along).sum(-1), 0, 1)
    return np.linalg.norm(start - share[..., None] * along, axis=-1)


CAMERAS = {
    "perspective": {
        "fx": 420.0,
        "fy": 410.0,
        "cx": 319.5,
        "cy": 239.5,
        "xi": 0.0,
        "width": 640,
        "height": 480,
    },
    "perspective with skew": {"fx": 420.0, "fy": 410.0, "skew": 12.5, "cx": 300.25, "cy": 250.5, "xi": 0.0},
    "hyper-catadioptric": {"fx": -330.0, "fy": 335.0, "cx": 322.0, "cy": 245.0, "xi": 0.8, "dead_zone": 60.0},
    "para-catadioptric": {
        "fx": 260.0,
        "fy": 255.0,
        "skew": -3.0,
        "cx": 318.0,
        "cy": 236.0,
        "xi": 1.0,
        "dead_zone": 45.0,
    },
    "fisheye": FE185,
    "fisheye, any angle": {
        **FE185,
        "max_angle": None,
        "width": 1000,
        "height": 800,
        "cx": 500.0,
        "cy": 400.0,
    },
    "strong fisheye": {"fx": 400.0, "fy": 400.0, "cx": 320.0, "cy": 240.0, "xi": 2.2, "max_angle": 1.8},
}


def camera(name):
    """One of `CAMERAS`, completed; a dead zone lies off the centre."""
    full = {**FE185, "skew": 0.0, "max_angle": None, "dead_zone": None, "width": 640, "height": 480}
    full.update(copy.deepcopy(CAMERAS[name]))
    if isinstance(full["dead_zone"], float):
        full["dead_zone"] = {"center": [full["cx"] + 14.25, full["cy"] - 9.5], "radius": full["dead_zone"]}
    return full


def random_case(rng, points=4):
    """A random problem and path: any of the cameras, some violating, most of them not."""
    chosen = camera(rng.choice(list(CAMERAS)))
    turn = Rotation.from_rotvec(rng.normal(size=3) * rng.choice([0.0, 0.2, 0.7]))
    goal = rng.normal(size=3) * 0.15
    axis = rng.normal(size=3) * [1, 1, 0.4] + [0, 0, 1.2 if rng.random() < 0.7 else -0.2]
    middle = 0.8 * axis / np.linalg.norm(axis)
    targets = middle + rng.uniform(-0.12, 0.12, size=(points, 3))
    obstacles = [
        {
            "type": "sphere",
            "center": list(rng.normal(size=3) * 0.25),
            "radius": float(rng.choice([0.0, 0.03])),
        }
        for _ in range(rng.integers(0, 3))
    ]
    asked = problem(
        camera=chosen,
        points=targets.tolist(),
        goal={"translation": goal.tolist(), "quaternion": turn.as_quat(canonical=True).tolist()},
        obstacles=obstacles,
        clearance=0.02,
        visibility_margin=float(rng.choice([0.0, 2.5])),
        occlusion=bool(rng.random() < 0.5),
    )
    if rng.random() < 0.3:
        asked["workspace"] = {"min": [-0.6, -0.5, -0.55], "max": [0.5, 0.6, 0.62]}
    if rng.random() < 0.3:
        half_space = {"normal": [0.48, -0.6, 0.64], "offset": -0.1}
        asked["workspace"] = {**asked.get("workspace", {}), "half_spaces": [half_space]}
    return asked, path(asked, rng.normal(size=3) * 0.08, rng.normal(size=4) * 0.05)
