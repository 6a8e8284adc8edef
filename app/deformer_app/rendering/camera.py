"""A camera as plain numbers: aim, motion, projection to pixels and back."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformer import InputError

Vector = tuple[float, float, float]

# Up axis → the direction that shapes usually face.
_FRONT: dict[str, Vector] = {"x": (0, -1, 0), "y": (0, 0, 1), "z": (0, -1, 0)}
_UP: dict[str, Vector] = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1)}


def _unit(vector: ArrayLike) -> NDArray[np.float64]:
    array = np.asarray(vector, dtype=np.float64)
    return array / np.sqrt((array**2).sum())


@dataclass(frozen=True)
class Camera:
    """A perspective or orthographic camera.

    The eye of an orthographic camera is where its depths count from; nothing hides behind it.

    Args:
        position: position of the eye, in the data's units.
        focal: point that the centre of the image shows.
        up: direction that is up in the image; need not be perpendicular to the view.
        view_angle: full vertical field of view, in degrees.
        height: height of the image in the data's units, of an orthographic camera; None makes the
            camera a perspective one.
    """

    position: Vector
    focal: Vector
    up: Vector
    view_angle: float = 25.0
    height: float | None = None

    @property
    def is_orthographic(self) -> bool:
        """True if lines of sight are parallel."""
        return self.height is not None

    @property
    def distance(self) -> float:
        """Distance from the eye to the focal point."""
        return float(np.sqrt((np.subtract(self.position, self.focal) ** 2).sum()))

    def from_distance(self, distance: float) -> Camera:
        """Return the camera at another distance from its focal point."""
        eye = np.asarray(self.focal) + distance * self.axes()[2]
        return replace(self, position=_vector(eye))

    def orthographic(self) -> Camera:
        """Return the orthographic camera that shows what is at the focal point's depth alike."""
        return replace(self, height=float(self._heights(self.distance)))

    def perspective(self) -> Camera:
        """Return the perspective camera that shows what is at the focal point's depth alike.

        Its focal point and direction are the same; its eye has the distance that this takes.
        """
        if self.height is None:
            return self
        away = self.height / (2 * np.tan(np.radians(self.view_angle) / 2)) * self.axes()[2]
        return replace(self, position=_vector(self.focal + away), height=None)

    def _heights(self, depths: ArrayLike) -> NDArray[np.float64]:
        """Return the heights of the image at depths, in the data's units."""
        if self.height is not None:
            return np.full(np.shape(depths), self.height)
        return 2 * np.tan(np.radians(self.view_angle) / 2) * np.asarray(depths, dtype=np.float64)

    def axes(self) -> NDArray[np.float64]:
        """Return unit rows (3, 3): right, up, and backward (from the focal point to the eye)."""
        backward = _unit(np.subtract(self.position, self.focal))
        right = _unit(np.cross(self.up, backward))
        return np.stack([right, np.cross(backward, right), backward])

    def project(self, points: ArrayLike, size: tuple[int, int]) -> NDArray[np.float64]:
        """Return the pixels (N, 2) of `points` (N, 3) in an image of `size` (width, height).

        The origin is the top left corner of the image, x to the right and y downwards.
        """
        width, height = size
        local = (np.asarray(points, dtype=np.float64) - self.position) @ self.axes().T
        xy = height * local[:, :2] / self._heights(-local[:, 2:])
        return np.stack([width / 2 + xy[:, 0], height / 2 - xy[:, 1]], axis=1)

    def sight(self, point: ArrayLike) -> NDArray[np.float64]:
        """Return the unit direction (3,) in which a point (3,) is seen."""
        if self.is_orthographic:
            return -self.axes()[2]
        return _unit(np.subtract(point, self.position))

    def depths(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the depths (N,) of `points` (N, 3) along the view, negative behind the eye."""
        return (np.asarray(points, dtype=np.float64) - self.position) @ -self.axes()[2]

    def ray(self, pixel: ArrayLike, size: tuple[int, int]) -> Ray:
        """Return the line of sight through a pixel (2,) of an image of `size` (width, height)."""
        width, height = size
        x, y = np.asarray(pixel, dtype=np.float64)
        right, up, backward = self.axes()
        aside = self._heights(1.0) / height * ((x - width / 2) * right + (height / 2 - y) * up)
        eye = np.asarray(self.position, dtype=np.float64)
        if self.is_orthographic:
            return Ray(eye + aside, -backward, endless=True)
        return Ray(eye, aside - backward)

    def unproject(
        self, pixel: ArrayLike, depth: float, size: tuple[int, int]
    ) -> NDArray[np.float64]:
        """Return the point (3,) at a pixel (2,) that is `depth` from the eye along the view."""
        ray = self.ray(pixel, size)
        # A ray's direction reaches depth 1.
        return ray.origin + depth * ray.direction

    def pixel_size(self, point: ArrayLike, size: tuple[int, int]) -> float:
        """Return the length that one pixel spans at the depth of `point` (3,)."""
        return float(self._pixel_sizes(np.reshape(point, (1, 3)), size)[0])

    def _pixel_sizes(self, points: ArrayLike, size: tuple[int, int]) -> NDArray[np.float64]:
        return self._heights(np.maximum(self.depths(points), 1e-9)) / size[1]

    def raised(
        self, points: ArrayLike, pixels: float, size: tuple[int, int]
    ) -> NDArray[np.float64]:
        """Return points (N, 3) moved towards the viewer, each along its line of sight.

        Args:
            points: (N, 3).
            pixels: how far they move, in lengths of a pixel at their depths.
            size: width and height of the image.
        """
        far = np.asarray(points, dtype=np.float64)
        step = pixels * self._pixel_sizes(far, size)[:, None]
        if self.is_orthographic:
            return far + step * self.axes()[2]
        sight = self.position - far
        return far + step * sight / np.sqrt((sight**2).sum(axis=1, keepdims=True))

    def seen_from(self, backward: ArrayLike, up: ArrayLike) -> Camera:
        """Return the camera turned about its focal point to look along a direction.

        Args:
            backward: (3,) from the focal point to the eye.
            up: (3,) direction that is up in the image.
        """
        eye = self.focal + self.distance * _unit(backward)
        return replace(self, position=_vector(eye), up=_vector(_unit(up)))

    def orbited(self, right: float, down: float, sky: ArrayLike) -> Camera:
        """Return the camera turned about its focal point as on a turntable.

        Args:
            right: degrees that the scene turns to the right about `sky`.
            down: degrees that the scene tips towards the viewer, at most to a pole.
            sky: (3,) direction that stays up.
        """
        up = _unit(sky)
        offset = np.subtract(self.position, self.focal)
        side = np.cross(up, offset)
        across = float(np.sqrt((side**2).sum()))
        height = float(offset @ up)
        elevation = np.degrees(np.arctan2(height, across))
        side = self.axes()[0] if across < 1e-9 * np.sqrt((offset**2).sum()) else side / across
        front = np.cross(side, up)
        turn = np.radians(-right)
        front, side = (
            np.cos(turn) * front + np.sin(turn) * side,
            np.cos(turn) * side - np.sin(turn) * front,
        )
        rise = np.radians(np.clip(elevation + down, -89.0, 89.0))
        eye = self.focal + self.distance * (np.cos(rise) * front + np.sin(rise) * up)
        return replace(self, position=_vector(eye), up=_vector(up))

    def panned(self, right: float, down: float, size: tuple[int, int]) -> Camera:
        """Return the camera moved in its image plane, so that the scene moves by so many pixels."""
        axes, step = self.axes(), self.pixel_size(self.focal, size)
        shift = step * (-right * axes[0] + down * axes[1])
        return replace(
            self,
            position=_vector(self.position + shift),
            focal=_vector(self.focal + shift),
        )

    def zoomed(
        self,
        factor: float,
        pixel: ArrayLike,
        size: tuple[int, int],
        depth: float | None = None,
    ) -> Camera:
        """Return the camera nearer by `factor` (below 1: farther).

        Args:
            factor: by which things at `depth` become larger.
            pixel: (2,) of the point that stays where it is seen.
            size: width and height of the image.
            depth: of that point along the view, above 0 of a perspective camera; by default, that
                of the focal point. The new camera's focal point has the same depth as the point
                that stays.
        """
        if depth is None:
            depth = self.distance
        anchor = self.unproject(pixel, depth, size)
        eye = anchor + (self.position - anchor) / factor
        focal = eye - depth / factor * self.axes()[2]
        if self.height is None:
            return replace(self, position=_vector(eye), focal=_vector(focal))
        # Of parallel lines of sight the eye's depth means nothing; the point may lie behind it.
        away = self.distance / factor * self.axes()[2]
        return replace(
            self,
            height=self.height / factor,
            position=_vector(focal + away),
            focal=_vector(focal),
        )

    def holding(
        self, point: ArrayLike, pixel: ArrayLike, depth: float, size: tuple[int, int]
    ) -> Camera:
        """Return the camera, moved without a turn, that sees `point` (3,) at a pixel and depth."""
        shift = np.asarray(point, dtype=np.float64) - self.unproject(pixel, depth, size)
        return replace(
            self,
            position=_vector(self.position + shift),
            focal=_vector(self.focal + shift),
        )


def eased(count: int) -> NDArray[np.float64]:
    """Return positions (count,) in (0, 1] of a cosine easing: slow, fast, slow."""
    return 0.5 - 0.5 * np.cos(np.pi * np.arange(1, count + 1) / count)


def turntable(camera: Camera, count: int, sky: ArrayLike) -> list[Camera]:
    """Return the cameras of a full turn about the focal point, in equal steps, `camera` first.

    Args:
        camera: first camera.
        count: number of cameras.
        sky: (3,) direction that stays up.
    """
    return [camera.orbited(360.0 * n / count, 0.0, sky) for n in range(count)]


@dataclass(frozen=True, eq=False)
class Ray:
    """A half-line: `origin` (3,) and `direction` (3,) of any length; a whole line if `endless`."""

    origin: NDArray[np.float64]
    direction: NDArray[np.float64]
    endless: bool = False

    def along(self, point: ArrayLike, axis: ArrayLike) -> float | None:
        """Return the position on a line, in units of `axis` from `point`, closest to the ray.

        Args:
            point: (3,) point of the line.
            axis: (3,) unit direction of the line.

        Returns:
            The signed distance from `point`; None where line and ray are nearly parallel.
        """
        a, d = np.asarray(axis, dtype=np.float64), _unit(self.direction)
        across = 1.0 - (a @ d) ** 2
        if across < 1e-4:
            return None
        gap = self.origin - np.asarray(point)
        return float((gap @ a - (gap @ d) * (a @ d)) / across)

    def on_plane(self, point: ArrayLike, normal: ArrayLike) -> NDArray[np.float64] | None:
        """Return the intersection (3,) with a plane; None if behind or (nearly) parallel."""
        n, d = np.asarray(normal, dtype=np.float64), _unit(self.direction)
        slope = float(n @ d)
        if abs(slope) < 1e-3:
            return None
        distance = float(n @ (np.asarray(point) - self.origin)) / slope
        return self.origin + distance * d if distance > 0 or self.endless else None


def upright_axes(up: str = "y") -> NDArray[np.float64]:
    """Return unit rows (3, 3) of a shape that is upright along `up`: its left, up and front.

    Args:
        up: "x", "y" or "z", with a minus in front if the axis points down.

    Raises:
        InputError: `up` is not an axis.
    """
    name = up.removeprefix("-").lower()
    if name not in _UP:
        raise InputError(f"up axis: got {up!r}, expected x, y, z, -x, -y or -z")
    sky = np.asarray(_UP[name], dtype=np.float64) * (-1 if up.startswith("-") else 1)
    front = np.asarray(_FRONT[name], dtype=np.float64)
    return np.stack([np.cross(sky, front), sky, front])


def aim(
    vertices: ArrayLike,
    *,
    up: str = "y",
    azimuth: float = 30.0,
    elevation: float = 10.0,
    aspect: float = 1.0,
    margin: float = 0.08,
    orthographic: bool = False,
) -> Camera:
    """Return a camera that shows all of `vertices` as large as the image allows.

    Args:
        vertices: (..., 3) points to keep in view; several shapes may be stacked.
        up: axis that is up in the image, as for `upright_axes`.
        azimuth: turn about the up axis, in degrees; 0 looks at the front, positive from its left.
        elevation: height of the eye above the horizon, in degrees; from 90 and -90 the front is
            at the bottom and at the top of the image.
        aspect: width of the image over its height.
        margin: part of the image left empty on each side.
        orthographic: true for an orthographic camera.

    Raises:
        InputError: `up` is not an axis.
    """
    _, sky, front = upright_axes(up)
    turn, rise = np.radians(azimuth), np.radians(elevation)
    around = np.cos(turn) * front + np.sin(turn) * np.cross(sky, front)
    backward = np.cos(rise) * around + np.sin(rise) * sky

    at_pole = abs(abs(elevation) - 90.0) < 1e-6
    top = -np.sign(elevation) * around if at_pole else sky
    view = Camera(_vector(backward), (0.0, 0.0, 0.0), _vector(top))
    if orthographic:
        view = view.orthographic()
    return framed(view, vertices, aspect=aspect, margin=margin)


def framed(
    camera: Camera, vertices: ArrayLike, *, aspect: float = 1.0, margin: float = 0.08
) -> Camera:
    """Return the camera moved without a turn, so that it shows `vertices` as large as it can.

    Args:
        camera: its direction of view and its lens are kept.
        vertices: (..., 3) points to keep in view.
        aspect: width of the image over its height.
        margin: part of the image left empty on each side.
    """
    points = np.asarray(vertices, dtype=np.float64).reshape(-1, 3)
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    axes = camera.axes()
    local = (points - middle) @ axes.T

    tangent = np.tan(np.radians(camera.view_angle) / 2) * (1 - 2 * margin)
    depths = np.zeros(len(local)) if camera.is_orthographic else local[:, 2]
    spans = [(local[:, 0], aspect * tangent), (local[:, 1], tangent)]
    distance = max(*(_least_distance(x, depths, slope) for x, slope in spans))
    distance = max(distance, np.finfo(float).tiny)
    shift = np.array([_middle(x, depths, distance, slope) for x, slope in spans])
    focal = middle + shift @ axes[:2]
    eye = focal + distance * axes[2]
    moved = replace(camera, position=_vector(eye), focal=_vector(focal), height=None)
    return moved.orthographic() if camera.is_orthographic else moved


def _least_distance(x: NDArray, depths: NDArray, slope: float) -> float:
    """Return the distance of an eye that just sees all points between two lines of sight.

    Args:
        x: (n,) places of the points across the view.
        depths: (n,) how far they are towards the eye.
        slope: of the lines of sight, x over distance.
    """
    return float((x + slope * depths).max() - (x - slope * depths).min()) / (2 * slope)


def _middle(x: NDArray, depths: NDArray, distance: float, slope: float) -> float:
    """Return the place of an eye, at a distance, from which points lie in the picture's middle.

    Lines of sight of a slope meet at the eye that just sees all points between them. The smaller
    the slope the farther that eye is, so that the slope for a distance is found by bisection.
    """
    low, high = 0.0, slope
    for _ in range(30):
        slope = (low + high) / 2
        if _least_distance(x, depths, slope) > distance:
            low = slope
        else:
            high = slope
    return float((x + high * depths).max() + (x - high * depths).min()) / 2


def _vector(array: NDArray) -> Vector:
    x, y, z = (float(value) for value in array)
    return (x, y, z)
