"""Closed loops on rendered images beside those on projected points: do the rates of a study agree?

Run: ``python -m benchmarks.rendered_study [SCENES] [--method NAME]``. Scenes of the public benchmark's
perspective camera, nearer, with 12 points. Beside a run on projected points with 0.1 px of noise, each
scene is run on images: every one is drawn by `StudyRenderer` (dark balls of 8 mm at the points, grey ones
for obstacles, light walls), with 1.5 grey levels of noise, and its dots are found by `find_dots`. Which dot
is which point is known, as with tags: the one nearest to the true place, within 6 px. Dots that overlap, or
that a ball covers in part, are lost or off. 10 images a second in both. The two agree where the rate on
projected points lies in Wilson's interval of 95% of that on images; what differs row by row is named.
"""

from __future__ import annotations

import argparse

import numpy as np
from benchmarks.scene_runs import Run, run_method_on
from benchmarks.tables import print_table
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras import preset
from omniservo.geometry.arrays import FloatArray
from omniservo.perception import find_dots
from omniservo.simulation import StudyRenderer
from omniservo.studies import Rate, Study, load_study
from omniservo.studies.study_camera import StudyCamera, StudyImage
from omniservo.studies.study_scene import NoScene, StudyScene, draw_scene

CAMERA, GREY_NOISE, NEAR_PX = "perspective", 1.5, 6.0


class RenderedCamera(StudyCamera):
    """Finds a scene's points in rendered images."""

    def __init__(self, scene: StudyScene, random: np.random.Generator) -> None:
        super().__init__(scene, random)
        self._renderer = StudyRenderer(scene)

    def take(self, rotation: FloatArray, centre: FloatArray) -> StudyImage:
        """Return what is found in the image from a pose."""
        scene = self._scene
        pose = RigidTransform.from_components(centre, Rotation.from_matrix(rotation))
        drawn = self._renderer.render(pose).astype(np.float64).mean(axis=2)
        noisy = drawn + GREY_NOISE * self._random.standard_normal(drawn.shape)
        dots = find_dots(np.clip(np.rint(noisy), 0, 255).astype(np.uint8)).pixels
        true, in_view = scene.shown((scene.points - centre) @ rotation)
        in_view &= ~scene.hidden(scene.points, centre)
        pixels, found = np.zeros_like(true), np.zeros(len(true), dtype=np.bool_)
        if len(dots) and in_view.any():
            apart = np.linalg.norm(np.where(in_view[:, None], true, 1e6)[:, None] - dots, axis=2)
            nearest = apart.argmin(axis=1)
            alone = apart.argmin(axis=0)[nearest] == np.arange(len(true))
            found = in_view & alone & (apart.min(axis=1) < NEAR_PX)
            pixels[found] = dots[nearest[found]]
        return StudyImage(pixels, found, in_view)


def study_for(method: str) -> Study:
    """Return the public benchmark's study with nearer scenes, of one method."""
    given = load_study("paper-benchmark").model_dump(mode="json")
    given["target"] |= {"points": 12, "distance": {"uniform": [0.5, 0.7]}}
    given["start"] |= {"distance_ratio": {"uniform": [0.8, 1.3]}}
    given["images"] |= {"noise": 0.1, "rate": 10.0, "lost": 0.0, "dropped": 0.0}
    return Study.model_validate(given | {"cameras": {CAMERA: preset(CAMERA)}, "methods": (method,)})


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("scenes", nargs="?", type=int, default=30)
    parser.add_argument("--method", action="append", help="default: certified, ibvs, pbvs")
    given = parser.parse_args()
    print(f"{given.scenes} scenes, {CAMERA}\n")
    print_table(
        "| method | projected | rendered | agree | rows that differ | final error, medians [mm] |",
        (_row(study_for(name), given.scenes) for name in given.method or ("certified", "ibvs", "pbvs")),
    )


def _row(study: Study, count: int) -> str:
    pairs: dict[int, tuple[Run, Run]] = {}
    for number in range(count):
        try:
            scene = draw_scene(study, number, study.cameras[CAMERA])
        except NoScene:
            continue
        pairs[number] = (
            run_method_on(study, scene, number),
            run_method_on(study, scene, number, camera=RenderedCamera),
        )
    good = np.array([[run.success for run in pair] for pair in pairs.values()])
    rates = [Rate(int(good[:, k].sum()), len(good)) for k in range(2)]
    low, high = rates[1].interval
    differ = [number for number, (a, b) in zip(pairs, good, strict=True) if a != b]
    off = 1e3 * np.median([[run.translation for run in pair] for pair in pairs.values()], axis=0)
    said = (f"{r.count} of {r.of} ({100 * r.interval[0]:.0f}–{100 * r.interval[1]:.0f}%)" for r in rates)
    agree = "yes" if low <= rates[0].share <= high else "no"
    cells = f"`{study.methods[0]}`", *said, agree, str(differ or "–"), f"{off[0]:.2f}, {off[1]:.2f}"
    return " | ".join(cells)


if __name__ == "__main__":
    main()
