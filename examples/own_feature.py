"""A kind of feature of your own: nine dark marks in three rows, told apart by their place in the grid.

A kind finds, matches and follows. Prints the motion from what it matched, and what it finds near predictions.
"""

import numpy as np
from scipy import ndimage

import omniservo
from omniservo.perception import FeatureTracker, MatchedPoints
from omniservo.scenes import scene_of_task
from omniservo.simulation import UnifiedRenderer, World
from omniservo.tasks import load_task

CAMERA = omniservo.UnifiedCamera(260.0, 260.0, 161.0, 118.0, 0.9, 320, 240)


class GridKind:  # answers to omniservo.perception.FeatureKind, and to FeatureTracker
    name, least, most_blur = "marks of the grid", 9, 3.0

    def find(self, camera: omniservo.UnifiedCamera, image: np.ndarray) -> np.ndarray:
        labels, count = ndimage.label(image < 70)
        marks = [k for k in range(1, count + 1) if 15 < np.count_nonzero(labels == k) < 1000]
        return np.array(ndimage.center_of_mass(255.0 - image, labels, marks)).reshape(-1, 2)[:, ::-1]

    def match(self, camera: omniservo.UnifiedCamera, initial: np.ndarray, goal: np.ndarray) -> MatchedPoints:
        grids = []
        for marks in (self.find(camera, initial), self.find(camera, goal)):
            if len(marks) != 9:
                raise omniservo.InputError(f"an image shows {len(marks)} {self.name}, not 9")
            rows = marks[np.argsort(marks[:, 1])].reshape(3, 3, 2)  # top to bottom, then left to right
            grids.append(np.concatenate([row[np.argsort(row[:, 0])] for row in rows]))
        return MatchedPoints(*grids)

    def tracker(self, *_: object) -> FeatureTracker:
        return self

    def update(self, image: np.ndarray, predicted_pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        marks = np.vstack([self.find(CAMERA, image), [np.inf, np.inf]])  # the last one stands for none
        distances = np.linalg.norm(predicted_pixels[:, None] - marks, axis=2)  # NaN: no prediction, lost
        valid = distances.min(axis=1) < 8.0  # [px]
        return np.where(valid[:, None], marks[distances.argmin(axis=1)], np.nan), valid


def main() -> None:
    task = load_task("paper-example-1", camera=CAMERA)
    scene, true = scene_of_task(task), task.teach.initial_T_goal.transform
    renderer, rng = UnifiedRenderer(World(scene)), np.random.default_rng(0)
    goal_joints = scene.joints_for(scene.world_T_camera(scene.start_joints) * true, scene.start_joints)
    initial, goal = (renderer.photograph(joints, rng) for joints in (scene.start_joints, goal_joints))
    matched = GridKind().match(CAMERA, initial, goal)
    found = omniservo.estimate_two_view(CAMERA, matched.initial, matched.goal, scale=0.223557)
    off = 1e3 * np.linalg.norm(found.initial_T_goal.translation - true.translation)
    print(f"{len(matched)} {GridKind.name}: estimate {found.status}, {off:.2f} mm off")
    pixels, valid = GridKind().update(goal, matched.goal + 3.0)  # predictions are a little off
    print(f"{valid.sum()} found near predictions, {np.abs(pixels - matched.goal).max():.2f} px off")


if __name__ == "__main__":
    main()
