import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from omniservo.cameras import preset
from omniservo.errors import InputError
from omniservo.geometry.single_pose import single_pose
from omniservo.planning import PlanningProblem
from omniservo.robots import MountedCamera, Solid, load_arm
from omniservo.robots.path_following.follow_path import follow_path
from omniservo.scenes import Panel, Scene, SceneBox
from omniservo.targets import Tag
from omniservo.whole_arm import ArmSetting

HERE, MATRIX = RigidTransform.identity(), np.eye(4)
ARM = load_arm("rx60")

TAKERS = {
    "base_T_initial": lambda pose: ArmSetting(ARM, pose, HERE),
    "flange_T_camera": lambda pose: ArmSetting(ARM, HERE, pose),
    "ball: pose": lambda pose: Solid("ball", "sphere", np.array([0.1]), pose),
    "target_T_tag": lambda pose: Tag("tag36h11", 3, 0.04, pose),
    "panel 'a': world_T_panel": lambda pose: Panel("a", pose, np.ones(2), np.ones((2, 2))),
    "box 'a': world_T_box": lambda pose: SceneBox("a", pose, np.ones(3)),
    "scene: world_T_base": lambda pose: Scene(ARM, pose, HERE, preset("fe185"), np.zeros(6)),
    "initial_T_goal": lambda pose: PlanningProblem(preset("fe185"), [[0, 0, 1]], pose),
}


@pytest.mark.parametrize("name", TAKERS)
@pytest.mark.parametrize(
    ("given", "said"), [(MATRIX, "an array (4, 4)"), (RigidTransform.identity(2), "2 poses"), (None, "None")]
)
def test_what_takes_a_pose_names_itself_what_was_given_and_what_is_legal(name, given, said):
    with pytest.raises(InputError) as refusal:
        TAKERS[name](given)
    assert str(refusal.value).startswith(f"{name}: {said} given; one RigidTransform is needed")


@pytest.mark.parametrize(
    "call",
    [
        MountedCamera,
        lambda pose: ARM.camera_jacobian(np.zeros(6), pose),
        lambda pose: follow_path(ARM, None, HERE, pose),
        lambda pose: single_pose("flange_T_camera", pose),
    ],
)
def test_a_matrix_for_the_mount_is_refused(call):
    with pytest.raises(InputError, match=r"flange_T_camera: an array \(4, 4\) given"):
        call(MATRIX)
