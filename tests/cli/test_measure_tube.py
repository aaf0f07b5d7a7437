"""``omniservo robot measure-tube``: from logs of runs to what an arm strays."""

import csv
import json

import numpy as np
import pytest
from tests.cli.calling import call

from omniservo.robots import TrackingTube, load_arm
from omniservo.runs.measure_tube import measure_tube
from omniservo.tasks import load_task

START, WAY = np.array([0.0, 0.4, -0.8, 0.1, 0.7, 0.2]), np.array([0.3, 0.1, 0.0, 0.0, 0.2, 0.0])


def log(path, beside, **without):
    """A run along a line of joints, ``beside`` it in j4 [rad]; its point is 2 px beside the reference."""
    with path.open("w", newline="") as file:
        names = [f"{name}_{i}" for name in ("joints", "planned_joints") for i in range(6)]
        points = [f"{name}_0_{k}" for name in ("pixels", "reference_pixels") for k in range(2)]
        writer = csv.writer(file)
        writer.writerow([without.get(name, name) for name in ("time", *names, *points)])
        for w in np.linspace(0.0, 1.0, 20):
            planned = START + w * WAY
            executed = planned + beside * np.eye(6)[3]
            writer.writerow([4 * w, *executed, *planned, 100.0, 50.0, 100.0, 52.0])
    return path


def test_runs_become_a_tube_that_a_task_can_name(capsys, tmp_path):
    runs = [log(tmp_path / f"{i}.csv", 1e-3 * i) for i in (4, 1, 2)]
    (tmp_path / "folder").mkdir()
    runs.append((log(tmp_path / "folder" / "log.csv", 3e-3)).parent)
    out = tmp_path / "tube.json"
    code, said, err = call(capsys, "robot", "measure-tube", "paper-example-1", *runs, "--out", out, "--json")
    assert (code, err) == (0, "")
    assert json.loads(said)["runs"] == 4
    arm, w = load_arm("rx60"), np.linspace(0.0, 1.0, 20)
    mount = load_task("paper-example-1").arm.flange_T_camera.transform
    jacobians = [arm.scaled_camera_jacobian(START + s * WAY, mount) for s in w]
    tube = TrackingTube.load(out).at(0.25)
    least = np.linalg.svd(jacobians, compute_uv=False)[:, -1].min()
    assert tube.singular_value == pytest.approx(least, rel=1e-6)
    assert tube.joints[3] == pytest.approx(3e-3, rel=1e-3)  # the first run shapes the tube
    assert tube.image == pytest.approx(2.0 * 2.0 * 0.75, rel=1e-3)
    assert tube.links["camera"] < 3e-3 * 0.2
    alone = {link: most for link, most in tube.links.items() if "&" not in link}
    assert tube.links["shoulder"] == pytest.approx(0.5 * max(alone.values()), rel=1e-5)


def test_points_stray_by_both_coordinates_in_whichever_order_columns_stand(tmp_path):
    names = [f"{name}_{i}" for name in ("joints", "planned_joints") for i in range(6)]
    points = ["pixels_0_0", "pixels_1_0", "pixels_0_1", "pixels_1_1"]
    row = [*START, *START, 3.0, 0.0, 4.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    runs = []
    for k in range(2):
        runs.append(tmp_path / f"{k}.csv")
        with runs[-1].open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerows([[*names, *points, *(f"reference_{name}" for name in points)], row, row])
    tube = measure_tube(load_task("paper-example-1"), runs)
    assert tube.shape[-1] == pytest.approx(2.0 * 5.0)


@pytest.mark.parametrize(
    ("renamed", "said"),
    [
        ("planned_joints_5", "planned_joints_0 … planned_joints_5"),
        ("joints_2", "joints_0 … joints_5"),
        ("reference_pixels_0_1", "reference_pixels"),
    ],
)
def test_a_log_without_what_is_needed_is_refused_by_name(capsys, tmp_path, renamed, said):
    path = log(tmp_path / "log.csv", 0.0, **{renamed: "other"})
    code, out, err = call(
        capsys, "robot", "measure-tube", "paper-example-1", path, "--out", tmp_path / "tube.json"
    )
    assert (code, out) == (2, "")
    assert said in err
    assert not (tmp_path / "tube.json").exists()


def test_one_run_says_nothing_of_the_next(capsys, tmp_path):
    out = tmp_path / "tube.json"
    path = log(tmp_path / "log.csv", 1e-3)
    code, said, err = call(capsys, "robot", "measure-tube", "paper-example-1", path, "--out", out)
    assert (code, said) == (2, "")
    assert "runs: 1 given; at least 2 are needed, and for a risk of 1% about three hundred" in err
    assert not out.exists()
