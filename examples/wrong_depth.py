"""Enter a method in the public benchmark: position-based servoing that takes all for twice as far away.

In the whole benchmark: omniservo study paper-benchmark --method-file wrong_depth.py:WrongDepth --out DIR
Prints what it does beside pbvs on the first scenes of the study "quick". The translation that is still to go
is taken for twice as long. What is 0 stays 0, so it ends at the same goal; but where the twist is scaled down
to the speed limits, the turn is scaled down with it, and the goal is reached later.
"""

import numpy as np

from omniservo.errors import FeatureLoss
from omniservo.servoing import ServoMeasurement
from omniservo.studies import Program, StudyTally, load_study, run_row

SCENES = 8  # two cameras, in turn


class WrongDepth:  # answers to omniservo.servoing.ServoMethod
    factor = 2.0  # depth taken over the true one

    def __init__(self, gain: float) -> None:
        self.gain = gain  # [1/s], the study's servo.gain

    def step(self, seen: ServoMeasurement) -> np.ndarray:
        if len(seen.bearings) < 4:
            raise FeatureLoss(f"{len(seen.bearings)} points are seen; at least 4 are needed")  # a named stop
        camera_T_goal = seen.goal_T_camera.inv()
        move, turn = self.factor * camera_T_goal.translation, camera_T_goal.rotation.as_rotvec()
        return self.gain * np.concatenate((move, turn))  # camera frame: [m/s], [rad/s]


def main() -> None:
    program = Program.of([f"{__file__}:WrongDepth"])
    study = load_study("quick", program.names)
    compared = ("pbvs", *program.names)
    wanted = [row for row in range(SCENES * len(study.methods)) if study.place(row)[2] in compared]
    tally = StudyTally()
    for row in wanted:
        tally.add(run_row(study, row, program).row)
    for each in tally.summaries():
        good, hit = each.success, each.collision.count
        ended = f"{good.count} of {good.of} reach the goal, after {each.seconds.value:.1f} s; {hit} collide"
        print(f"{each.method}: {ended}")


if __name__ == "__main__":
    main()
