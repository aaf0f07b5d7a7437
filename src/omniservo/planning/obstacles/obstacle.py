"""All kinds of obstacle."""

from omniservo.planning.obstacles.box import Box
from omniservo.planning.obstacles.capsule import Capsule
from omniservo.planning.obstacles.cloud import Cloud
from omniservo.planning.obstacles.half_space import HalfSpace
from omniservo.planning.obstacles.mesh import Mesh
from omniservo.planning.obstacles.sphere import Sphere

Obstacle = Sphere | Box | Capsule | HalfSpace | Mesh | Cloud
