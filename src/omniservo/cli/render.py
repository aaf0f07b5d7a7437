"""``omniservo render``."""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from omniservo.cli.camera_options import CameraFile, CameraOption, MaxAngleOption
from omniservo.cli.grouped import grouped
from omniservo.cli.output import ForceOption, Output
from omniservo.errors import InputError, spelled
from omniservo.files import require_file, writable, write_whole

if TYPE_CHECKING:
    from scipy.spatial.transform import RigidTransform

    from omniservo.geometry.arrays import ByteArray
    from omniservo.simulation import Rendering

_STILLS = (".png",)
_VIDEOS = (".mp4", ".avi", ".gif")
_RATE = 25.0
"""frames a second of a video"""

_LEGAL_POSE = "x,y,z,qx,qy,qz,qw (world_T_camera), or x,y,z,X,Y,Z (from one point, looking at the other)"

SceneArgument = Annotated[Path, typer.Argument(help="A MuJoCo model (MJCF).")]
PoseOption = Annotated[
    str, typer.Option("--pose", help=f"Where the camera is, or where --path starts: {_LEGAL_POSE}.")
]
PathOption = Annotated[
    Path | None, typer.Option("--path", help="A plan file: the camera goes along its path, from --pose on.")
]
FramesOption = Annotated[int, typer.Option("--frames", min=2, max=5000, help="Of a video, 25 a second.")]


@dataclass(frozen=True)
class _Files:
    """What is written, and where."""

    out: Annotated[
        Path,
        typer.Option("--out", help="Write the image (.png), or the video of --path (.mp4, .avi, .gif)."),
    ]
    depth: Annotated[
        Path | None,
        typer.Option("--depth", help="Write distances along rays: .npy in m, or .png of 16 bits in mm."),
    ] = None
    segmentation: Annotated[
        Path | None,
        typer.Option(
            "--segmentation", help="Write geom numbers: .npy (-1: none), or .png of 16 bits (0: none)."
        ),
    ] = None
    force: ForceOption = False

    def check(self, *, is_video: bool) -> None:
        """Refuse what cannot be written, before the work."""
        legal = _VIDEOS if is_video else _STILLS
        if self.out.suffix not in legal:
            what = "a video" if is_video else "an image"
            raise InputError(f"--out: {self.out} given; legal for {what}: {', '.join(legal)}")
        for name, path in (("--depth", self.depth), ("--segmentation", self.segmentation)):
            if path is not None and is_video:
                raise InputError(f"{name}: given with --path; it goes with one image")
            if path is not None and path.suffix not in (".npy", ".png"):
                raise InputError(f"{name}: {path} given; legal: a file that ends with .npy or .png")
        paths = list(self.written())
        for k, path in enumerate(paths):
            writable(path, force=self.force)
            if path.resolve() in [other.resolve() for other in paths[:k]]:
                raise InputError(f"--out, --depth, --segmentation: {path} given twice; legal: a file each")

    def written(self) -> Iterator[Path]:
        """Yield what is."""
        return filter(None, (self.out, self.depth, self.segmentation))


@grouped
def render(
    scene: SceneArgument,
    *,
    camera: CameraOption,
    pose: PoseOption,
    path: PathOption = None,
    frames: FramesOption = 100,
    files: _Files,
    file: CameraFile,
    max_angle: MaxAngleOption = None,
    output: Output,
) -> None:
    """Draw a MuJoCo model as a calibrated camera sees it; with --path, as a video along a plan's path."""
    files.check(is_video=path is not None)
    for given in filter(None, (scene, path)):
        require_file(given)
    with output.working("loading") as progress:
        import mujoco
        import numpy as np

        from omniservo.planning import Plan
        from omniservo.simulation import ModelRenderer, load_scene_model

        world_T_start = _pose(pose)
        way = None if path is None else Plan.load(path).path
        if path is not None and way is None:
            raise InputError(f"--path: {path}: the plan has no path")
        lens = file.open(camera, max_angle)
        world = load_scene_model(scene)
        data = mujoco.MjData(world)
        mujoco.mj_forward(world, data)
        renderer = ModelRenderer(world, lens)
        places = np.linspace(0.0, 1.0, frames) if way is not None else np.zeros(1)
        last: list[Rendering] = []

        def images() -> Iterator[ByteArray]:
            for k, w in enumerate(places):
                progress(f"drawing image {k + 1} of {len(places)}", k / len(places))
                last[:] = [renderer.render(data, world_T_start if way is None else world_T_start * way(w))]
                yield last[0].image

        _write(files, images(), last)
    for written in files.written():
        output.written(written)
    output.result({"out": str(files.out), "frames": len(places), **_fields(world, last[0])}, "render")


def _write(files: _Files, images: Iterator[ByteArray], last: list[Rendering]) -> None:
    """Write the images as they are drawn, and what is requested of the last."""
    import numpy as np

    from omniservo.files.image_files import write_png
    from omniservo.simulation.video import video_bytes

    if files.out.suffix in _VIDEOS:
        write_whole(files.out, video_bytes(images, files.out.suffix, _RATE), force=files.force)
    else:
        write_png(next(images), files.out, force=files.force)
    (seen,) = last
    millimetres = np.nan_to_num(1e3 * seen.distance).clip(0, 65535)
    for path, values, whole in (
        (files.depth, seen.distance.astype(np.float32), millimetres),
        (files.segmentation, seen.geoms.astype(np.int32), seen.geoms + 1),
    ):
        if path is not None:
            write_whole(path, _array_bytes(path, values, whole), force=files.force)


def _array_bytes(path: Path, values: Any, whole: Any) -> bytes:
    """Return values as the bytes of a .npy file, or whole ones as those of a PNG image of 16 bits."""
    import numpy as np
    from PIL import Image

    stream = io.BytesIO()
    if path.suffix == ".npy":
        np.save(stream, values, allow_pickle=False)
    else:
        Image.fromarray(np.rint(whole).astype(np.uint16)).save(stream, "PNG")
    return stream.getvalue()


def _fields(world: Any, seen: Rendering) -> dict[str, Any]:
    """Return what a program wants to know of the last image."""
    import mujoco
    import numpy as np

    geoms = [int(geom) for geom in np.unique(seen.geoms) if geom >= 0]
    named = [
        {
            "geom": geom,
            "name": mujoco.mj_id2name(world, mujoco.mjtObj.mjOBJ_GEOM, geom),
            "body": world.body(int(world.geom_bodyid[geom])).name,
        }
        for geom in geoms
    ]
    height, width = seen.geoms.shape
    known = seen.distance[seen.geoms >= 0]
    nearest = float(known.min()) if known.size else None
    return {"size": [width, height], "valid": float(seen.valid.mean()), "nearest_m": nearest, "geoms": named}


def _pose(text: str) -> RigidTransform:
    """Return world_T_camera of ``--pose``.

    Raises:
        InputError: not of either form, not finite, or eye and point coincide or stand above each other.
    """
    import numpy as np
    from scipy.spatial.transform import RigidTransform, Rotation

    try:
        numbers = np.array([float(word) for word in text.split(",")])
    except ValueError:
        numbers = np.zeros(0)
    wrong = InputError(f"--pose: {spelled(text)} given; legal: {_LEGAL_POSE}")
    if len(numbers) not in (6, 7) or not np.isfinite(numbers).all():
        raise wrong
    eye, rest = numbers[:3], numbers[3:]
    if len(rest) == 4:
        if abs(np.linalg.norm(rest) - 1.0) > 1e-6:
            raise InputError(f"--pose: a quaternion of length {np.linalg.norm(rest):.6g} given; legal: 1")
        return RigidTransform.from_components(eye, Rotation.from_quat(rest))
    ahead = rest - eye
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    if np.linalg.norm(right) < 1e-9 * max(float(np.linalg.norm(ahead)), 1e-9):
        raise InputError(f"--pose: {spelled(text)} given; legal: points that do not stand above each other")
    axes = np.stack([right, np.cross(ahead, right), ahead], axis=1)
    axes /= np.linalg.norm(axes, axis=0)
    return RigidTransform.from_components(eye, Rotation.from_matrix(axes))
