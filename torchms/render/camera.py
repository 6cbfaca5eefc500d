"""A pinhole camera."""

import math
from dataclasses import dataclass

import torch
from torch import Tensor

Point = tuple[float, float, float]


@dataclass(frozen=True)
class Camera:
    """A pinhole at `eye` that looks at `target`; the picture's height covers `fov` degrees, y is up.

    Raises ValueError if eye and target coincide or fov is outside (0, 180).
    """

    eye: Point
    target: Point = (0.0, 0.0, 0.0)
    fov: float = 45.0

    def __post_init__(self) -> None:
        if math.dist(self.eye, self.target) < 1e-9:
            raise ValueError(f"Camera(eye=..., target=...) must be two points; both are {self.eye}. Move one of them.")
        if not 0 < self.fov < 180:
            raise ValueError(f"Camera(fov=...) must lie in (0, 180) degrees; got {self.fov:g}.")

    def rays(self, x: Tensor, y: Tensor, aspect: float) -> tuple[Tensor, Tensor]:
        """Origins and unit directions (n, 3) through the picture at x, y in [0, 1], from its upper left corner.

        aspect: width over height.
        """
        eye = torch.tensor(self.eye, dtype=torch.float64)
        forward = torch.nn.functional.normalize(torch.tensor(self.target, dtype=torch.float64) - eye, dim=0)
        # Looking straight up or down, z serves as the upper edge.
        up = torch.tensor([0.0, 1.0, 0.0] if abs(float(forward[1])) < 0.9999 else [0.0, 0.0, -1.0], dtype=torch.float64)
        right = torch.nn.functional.normalize(torch.linalg.cross(forward, up), dim=0)
        above = torch.linalg.cross(right, forward)
        half = math.tan(math.radians(self.fov) / 2)
        across, down = (2 * x.double() - 1) * (half * aspect), (2 * y.double() - 1) * half
        direction = forward + across[:, None] * right - down[:, None] * above
        return eye.expand(len(x), 3), torch.nn.functional.normalize(direction, dim=-1)
