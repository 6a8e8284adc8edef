"""One model on the desk: its session, its solver beside the window, and the picture of both.

A desk shows whatever the session holds and says when something changes; what a user can do with
it is in `editor`.
"""

from __future__ import annotations

import hashlib
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

import deformer
from deformer import DeformationModel, InputError, Mesh, io
from deformer_app.rendering.camera import Camera, aim, upright_axes
from deformer_app.rendering.palette import DARK, KINDS, LIGHT, SELECTED
from deformer_app.viewer.colouring import Paint
from deformer_app.viewer.controller import Hover
from deformer_app.viewer.gizmo import Gizmo, Mode
from deformer_app.viewer.pose_worker import Answer, Poser, Request
from deformer_app.viewer.scene import Marks, MeshView
from deformer_app.viewer.session import Edit, Handle, ModelName, Session, Solution, point
from deformer_app.viewer.worker import SolverThread, beside

_REST = 0.25  # seconds without change after which the picture is drawn sharply
_GLIDE = 0.12  # seconds from the last pose of a drag to the final one
# Seconds after a frame that the next one waits for the pose it belongs to. During a drag a frame
# without it shows next to nothing, and is in the way of the one that follows.
_LATE, _LATE_IN_DRAG = 0.03, 0.15


@dataclass(frozen=True)
class Look:
    """How the picture is drawn; kept with the session."""

    colour: str = "plain"
    ghost: Literal["none", "reference", "target"] = "none"
    wireframe: bool = False
    smooth: bool = True
    dark: bool = False


class Desk:
    """One model, its session, its solver and its picture.

    Args:
        view: the picture.
        notify: called on another thread when `tick` has something to do.
    """

    def __init__(self, view: MeshView, notify: Callable[[], None] = lambda: None) -> None:
        """Begin without a model."""
        self.view = view
        self.camera = Camera((0, 0, 5), (0, 0, 0), (0, 1, 0))
        self.mode: Literal["drag", "paint"] = "drag"
        self.gizmo_mode: Mode = "move"
        self.gizmo_shown = True
        self.look = Look()
        self.target: Mesh | None = None
        self._target_file: dict[str, str] | None = None
        self.on_change: list[Callable[[str], None]] = []
        self.latencies: deque[float] = deque(maxlen=200)  # seconds, from a move to its frame
        self.answer: Answer | None = None
        # Strengths and limits of the components, once they have been measured.
        self.activations: deformer.Activations | None = None
        self._notify = notify
        self._model: DeformationModel | None = None
        self._session: Session | None = None
        self._thread: SolverThread[Request, Answer] | None = None
        self._selected: frozenset[int] = frozenset()
        self._hover = Hover()
        self._dirty = False
        self._asked: dict[int, float] = {}
        self._number = 0
        self._changed_at = self._drawn_at = 0.0
        self._jobs: list[Iterator[None]] = []
        self.on_frame: Callable[[], None] | None = None
        self.message = self.notice = ""
        self._paint: Paint | None = None

    @property
    def model(self) -> DeformationModel:
        """The model that is edited."""
        assert self._model is not None, "no model is open"
        return self._model

    @property
    def session(self) -> Session:
        """What is being done to it."""
        assert self._session is not None, "no model is open"
        return self._session

    @property
    def is_open(self) -> bool:
        """Whether there is a model."""
        return self._model is not None

    @property
    def edit(self) -> Edit:
        """The present state."""
        return self.session.edit

    def open_model(self, path: str | Path, session: Session | None = None) -> None:
        """Open a model, with a session of it or a new one.

        Raises:
            InputError: no such model, or the session belongs to another.
        """
        model = deformer.load_model(path)
        if session is not None:
            session.check_fits(model, path)
        if self._thread is not None:
            self._thread.close(0.0)
        self._model, self.answer, self.activations = model, None, None
        self.target, self._target_file = None, None
        name = ModelName(_portable(path), model.fingerprint)
        self._session = session or Session.begin(name, self.start_codes()["Reference"])
        self._selected, self._hover = frozenset(), Hover()
        self.mode = "drag"
        reference = model.reference
        normals = deformer.vertex_normals(reference.vertices, reference.faces)
        self.view.set_mesh(reference.vertices, reference.faces, normals)
        self._restore_view()
        self._thread = SolverThread(_lazily(model), self._notify)
        self.ask(self.session.entry.solution)
        self._emit("model", "history", "handles", "look")

    def open_session(self, path: str | Path, model: str | Path | None = None) -> None:
        """Open a saved session and the model it belongs to.

        Raises:
            InputError: the session is damaged, or its model is not where it was.
        """
        session = Session.load(path)
        self.open_model(model or session.model.path, session)

    def close(self) -> None:
        """End the solver's thread."""
        if self._thread is not None:
            self._thread.close()
            self._thread = None

    def save_session(self, path: str | Path) -> None:
        """Write the session to a file."""
        self._note_view()
        self.session.save(path)
        self._emit("history")

    def write_copy(self, path: str | Path) -> None:
        """Write the session to a file that does not count as saving."""
        self._note_view()
        self.session.write_copy(path)

    def _note_view(self) -> None:
        camera, look = self.camera, self.look
        self.session.view = {
            "camera": {
                "position": list(camera.position),
                "focal": list(camera.focal),
                "up": list(camera.up),
                "view_angle": camera.view_angle,
            },
            "look": vars(look),
            "target": self._target_file,
        }

    def _restore_view(self) -> None:
        seen = self.session.view
        self.frame()
        try:
            kept = seen.get("camera")
            if kept:
                position, focal, up = (point(kept[n]) for n in ("position", "focal", "up"))
                self.camera = Camera(position, focal, up, float(kept["view_angle"]))
            look = Look(**seen.get("look", {}))
            if seen.get("target") is not None:
                self._restore_target(str(seen["target"]["path"]), str(seen["target"]["sha256"]))
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise InputError(f"session: damaged view ({error}); remove 'view' from it") from error
        if self.target is None:
            ghost = "none" if look.ghost == "target" else look.ghost
            colour = "plain" if look.colour == "error" else look.colour
            look = replace(look, ghost=ghost, colour=colour)
        self.change_look(**vars(look))
        self.camera_moved()

    def load_target(self, path: str | Path) -> None:
        """Compare with a mesh of the same connectivity.

        Raises:
            InputError: it has another number of vertices.
        """
        self._take_target(path)
        self.change_look(ghost="target", colour="error")

    def _take_target(self, path: str | Path) -> None:
        mesh, file = self._load_alike(path), Path(path).resolve()
        self.target = mesh
        self._target_file = {"path": str(file), "sha256": _checksum(file)}

    def _restore_target(self, path: str, checksum: str) -> None:
        """Load the mesh that a session was compared with; say so where that is not possible."""
        try:
            self._take_target(path)
        except (InputError, OSError) as error:
            self._failed(InputError(f"The target mesh of this session cannot be loaded: {error}"))
            self._target_file = {"path": path, "sha256": checksum}  # it may come back
        else:
            if self._target_file != {"path": path, "sha256": checksum}:
                self._failed(InputError(f"{path}: the target mesh has changed since it was saved"))

    def _load_alike(self, path: str | Path) -> Mesh:
        mesh, reference = io.load_mesh(path), self.model.reference
        if mesh.vertices.shape != reference.vertices.shape:
            raise InputError(
                f"{path}: {len(mesh.vertices)} vertices, expected {len(reference.vertices)} as the "
                "model has; choose a mesh of the same connectivity"
            )
        return mesh

    def start_codes(self) -> dict[str, NDArray[np.float64]]:
        """Latent codes to start from, by name: the reference and every training shape."""
        model = self.model
        train = model.split.get("train") or range(len(model.codes))
        codes = {f"Shape {n}": z for n, z in zip(train, model.codes, strict=False)}
        first = codes.get(f"Shape {model.summary.get('reference', 0)}")
        if first is None:
            first = model.encode(model.reference.vertices)
        return {"Reference": first, "Mean": model.latent_mean, **codes}

    @property
    def vertices(self) -> NDArray[np.float64]:
        """The surface (V, 3) that is shown."""
        return self.model.reference.vertices if self.answer is None else self.answer.pose.vertices

    @property
    def code(self) -> NDArray[np.float64]:
        """The latent code (K,) of the pose that is shown."""
        return np.array(self.edit.base) if self.answer is None else self.answer.pose.z

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the picture in pixels."""
        return self.view.size

    @property
    def up(self) -> str:
        """Name of the model's up axis."""
        return str(self.model.summary.get("up", "y")) if self.is_open else "y"

    @property
    def sky(self) -> ArrayLike:
        """The model's up direction."""
        return upright_axes(self.up)[1]

    def frame(self, azimuth: float = 25.0, elevation: float = 8.0) -> None:
        """Look at all of the shape from a direction, in degrees; see `aim`."""
        width, height = self.size
        self.camera = aim(
            self.vertices,
            up=self.up,
            azimuth=azimuth,
            elevation=elevation,
            aspect=width / height,
            margin=0.17,
        )
        self.camera_moved()

    def camera_moved(self) -> None:
        """The camera has another place."""
        self.view.look(self.camera)
        self._touch()
        self._emit("camera")

    def change_look(self, **changes: Any) -> None:
        """Change how the picture is drawn; see `Look`."""
        before, self.look = self.look, replace(self.look, **changes)
        look, view = self.look, self.view
        if look.dark != (view.theme is DARK):
            view.set_theme(DARK if look.dark else LIGHT)
        view.show_as(look.smooth, look.wireframe)
        ghosts = {"reference": self.model.reference, "target": self.target, "none": None}
        view.show_ghost(ghosts[look.ghost])
        if before.colour != look.colour:
            self._paint = None
            view.paint(None)
            self._repaint()
        self._touch()
        self._emit("look")

    def _repaint(self) -> None:
        self.ask(self.answer.solution if self.answer and self._is_final() else None)

    def _is_final(self) -> bool:
        answer = self.answer
        return answer is not None and answer.final and answer.request.edit == self.edit

    @property
    def selected(self) -> frozenset[int]:
        """Ids of the selected handles."""
        return self._selected

    @property
    def hovered(self) -> Hover:
        """What is under the cursor."""
        return self._hover

    @property
    def gizmo(self) -> Gizmo | None:
        """The manipulator of what is selected and can be moved."""
        held = self._movable()
        if not held or not self.gizmo_shown or self.mode == "paint":
            return None
        several = sum(len(handle.vertices) for handle in held) > 1
        centre = point(np.mean([handle.centre for handle in held], axis=0))
        return Gizmo(centre, self.gizmo_mode if several else "move")

    def _held(self) -> list[Handle]:
        return [handle for handle in self.edit.handles if handle.id in self._selected]

    def _movable(self) -> list[Handle]:
        return [handle for handle in self._held() if handle.kind != "pin"] if self.is_open else []

    def _keep_selection(self) -> None:
        self._selected &= {handle.id for handle in self.edit.handles}

    # Time.

    @property
    def dragging(self) -> bool:
        """Whether a button of the mouse is down."""
        return False

    def ask(self, solution: Solution | None = None, moving: bool = False) -> None:
        """Have the present state solved."""
        if self._thread is None:
            return
        self._number += 1
        self._asked[self._number] = time.perf_counter()
        target = None if self.target is None else self.target.vertices
        self._thread.ask(
            Request(
                self.edit,
                solution,
                moving,
                self.look.colour,
                target,
                self.activations,
                self._number,
            )
        )
        self._touch()

    @property
    def busy(self) -> bool:
        """Whether an answer or a frame is still to come."""
        solving = self._thread is not None and self._thread.busy
        return solving or self._dirty or bool(self._jobs)

    @property
    def idle(self) -> bool:
        """Whether `tick` has nothing to do until something changes."""
        return not (self.busy or self.dragging) and self.view.is_sharp

    @property
    def preparing(self) -> bool:
        """Whether the solver of a model is not ready yet."""
        return self.is_open and self.answer is None

    def run(self, job: Iterator[None]) -> None:
        """Do a step of `job` every tick, so that the window stays alive."""
        self._jobs.append(job)
        self._notify()

    def tick(self) -> None:
        """Take what the solver has, draw what has changed; never waits."""
        if self._thread is None:
            return
        for failure in self._thread.failures():
            self._failed(failure.error)
        answer = self._thread.take()
        if answer is not None:
            self._show(answer)
        now = time.perf_counter()
        late = _LATE_IN_DRAG if self.session.under_way else _LATE
        waiting = self._thread.busy and now - self._drawn_at < late and self.answer is not None
        if self._dirty and (answer is not None or not waiting):
            self._draw(answer)
        elif self._rests(now) and self.view.sharpen(True):
            self.view.render()
        for job in tuple(self._jobs):
            try:
                next(job)
            except StopIteration:
                self._jobs.remove(job)
            except (InputError, OSError) as error:
                self._jobs.remove(job)
                self._failed(error)

    def _rests(self, now: float) -> bool:
        return not (self._dirty or self.dragging) and now - self._changed_at > _REST

    def _show(self, answer: Answer) -> None:
        before, self.answer = self.answer, answer
        if before is None:
            self._asked.clear()  # what waited for the preparation tells nothing of the feel
            self.run(self._measure_components())
        if before is not None and answer.final and before.request.edit == answer.request.edit:
            self.run(self._glide(before.pose.vertices, answer))
        else:
            self.view.move_mesh(answer.pose.vertices, answer.normals)
        if answer.paint is not None:
            self._paint = answer.paint
            self.view.paint(answer.paint)
        if answer.final and answer.request.solution is None:
            self.session.solved(answer.request.edit, answer.solution)
        self._dirty = True
        self._emit("pose")

    def _measure_components(self) -> Iterator[None]:
        """Find strengths and limits of the components on a thread: seconds on a large mesh."""
        model = self.model
        found = yield from beside(lambda: deformer.Activations(model))
        if self._model is model:
            self.activations = found
            if self.look.colour.startswith("component"):
                self._repaint()
            self._emit("components")

    def _glide(self, start: NDArray[np.float64], answer: Answer) -> Iterator[None]:
        """Go from what a drag has shown to the final pose in a few frames.

        Rigid relaxation of exact handles depends on the way during a drag and is done afresh at
        its end: a difference of a per cent or two, which would look like a jump.
        """
        faces, begun = self.model.reference.faces, time.perf_counter()
        apart = float(np.abs(answer.pose.vertices - start).max())
        if apart < 1e-4 * self.model.reference.bounding_diagonal:
            begun -= _GLIDE
        while (share := (time.perf_counter() - begun) / _GLIDE) < 1.0:
            between = start + share * (answer.pose.vertices - start)
            self.view.move_mesh(between, deformer.vertex_normals(between, faces))
            self._dirty = True
            yield
            if self.answer is not answer:
                return
        self.view.move_mesh(answer.pose.vertices, answer.normals)
        self._dirty = True

    def _draw(self, answer: Answer | None) -> None:
        self._dirty = False
        self.view.sharpen(False)
        self._update_marks()
        self.view.render()
        self._drawn_at = time.perf_counter()
        if answer is not None:
            self._note_latency(answer)
        if self.on_frame is not None:
            self.on_frame()
        self._emit("frame")

    def _note_latency(self, answer: Answer) -> None:
        asked = self._asked.pop(answer.request.number, None)
        for number in [n for n in self._asked if n < answer.request.number]:
            del self._asked[number]
        if asked is not None and answer.request.moving:
            self.latencies.append(time.perf_counter() - asked)

    def _update_marks(self) -> None:
        marks, _ = self._marks()
        self.view.show_handles(marks)
        vertex = self._hover.vertex
        self.view.show_hover([] if vertex is None else self.vertices[[vertex]])
        self.view.show_gizmo(self.gizmo, self._hover.part)

    def _marks(self) -> tuple[Marks, list[int]]:
        """Balls of all handles, and the handle that each belongs to."""
        rows = [
            (vertex, target, handle)
            for handle in self.edit.handles
            for vertex, target in zip(handle.vertices, handle.targets, strict=True)
        ]
        index = [vertex for vertex, _, _ in rows]
        colours = [
            SELECTED if handle.id in self._selected else KINDS[handle.kind] for _, _, handle in rows
        ]
        sizes = [
            (8 if handle.is_region else 14) + (4 if handle.id == self._hover.handle else 0)
            for _, _, handle in rows
        ]
        targets = np.array([target for _, target, _ in rows]).reshape(-1, 3)
        return Marks(self.vertices[index], targets, colours, sizes), [h.id for _, _, h in rows]

    def note(self, text: str) -> None:
        """Tell the user something that is no mistake."""
        self.notice = text
        self._emit("notice")

    def _failed(self, error: Exception) -> None:
        self.message = str(error) if isinstance(error, InputError) else f"{error!r}"
        self._emit("message")

    def _touch(self) -> None:
        self._dirty, self._changed_at = True, time.perf_counter()
        self._notify()

    def _emit(self, *events: str) -> None:
        for event in events:
            for listener in self.on_change:
                listener(event)


def _checksum(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _lazily(model: DeformationModel) -> Callable[[Request], Iterator[Answer]]:
    """A poser that is prepared with the first request, on the thread that asks."""
    ready: list[Poser] = []

    def answer(request: Request) -> Iterator[Answer]:
        if not ready:
            poser = Poser(model)
            poser.rehearse()
            ready.append(poser)
        return ready[0](request)

    return answer


def _portable(path: str | Path) -> str:
    """A shipped model's name, or an absolute path."""
    return str(path) if str(path) in deformer.shipped_models() else str(Path(path).resolve())
