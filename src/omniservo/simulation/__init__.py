"""The simulator: its world, the ray-cast camera, the arm that moves in it, and the truth about both."""

from omniservo.renamed import renamed
from omniservo.simulation.outside_view import OutsideView, Viewpoint
from omniservo.simulation.real_time_robot import RealTimeRobot
from omniservo.simulation.render import ModelRenderer, Rendering, render
from omniservo.simulation.scene_file import load_scene_model
from omniservo.simulation.simulated_cell import SimulatedCell
from omniservo.simulation.simulated_robot import SimulatedRobot
from omniservo.simulation.study_renderer import StudyRenderer
from omniservo.simulation.take_picture import take_picture
from omniservo.simulation.unified_renderer import UnifiedRenderer
from omniservo.simulation.world import World

__all__ = [
    "ModelRenderer",
    "OutsideView",
    "RealTimeRobot",
    "Rendering",
    "SimulatedCell",
    "SimulatedRobot",
    "StudyRenderer",
    "UnifiedRenderer",
    "Viewpoint",
    "World",
    "load_scene_model",
    "render",
    "take_picture",
]

_SCENES = ("Ball", "Dots", "Panel", "Scene", "SceneBox", "Sensor", "scene_of_task")
__getattr__ = renamed(
    __name__, {name: f"omniservo.scenes.{name}" for name in _SCENES} | {"Box": "omniservo.scenes.SceneBox"}
)
