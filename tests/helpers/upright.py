"""Axes of Blender."""


def upright(vertices):
    """Positions of files whose y axis points up, as Blender has them, whose z axis does."""
    return vertices[..., [0, 2, 1]] * [1, -1, 1]
