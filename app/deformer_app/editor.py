"""The editor without its window: one model, its session, its solver and its picture.

A shell (a plain window, the Qt window, a test) feeds events to `controller`, calls `tick` when
there is time, and listens to `on_change`.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

import deformer
from deformer import DeformationModel, InputError, Mesh, io
from deformer.geodesics import spread
from deformer_app.camera import Camera, aim, upright_axes
from deformer_app.colouring import Paint
from deformer_app.controller import Controller, Hover, Pixel
from deformer_app.gizmo import Gizmo, Mode, Motion
from deformer_app.mesh_view import DARK, KIND_COLOURS, LIGHT, SELECTED, Marks, MeshView
from deformer_app.pictures import save_picture
from deformer_app.posing import Answer, Poser, Request
from deformer_app.session import Body, Edit, Handle, Kind, ModelName, Session, Solution, point
from deformer_app.solver_thread import SolverThread

# A region is held by so many of its vertices.
_HOLDS = 8
_REST = 0.25  # seconds without change after which the picture is drawn sharply
_LATE = 0.03  # seconds that marks wait for the pose they belong to
_NEAR = 10.0  # pixels from a handle within which the mouse takes it


@dataclass(frozen=True)
class Look:
    """How the picture is drawn; kept with the session."""

    colour: str = "plain"
    ghost: Literal["none", "reference", "target"] = "none"
    wireframe: bool = False
    smooth: bool = True
    dark: bool = False


class Editor:
    """Edits one model at a time.

    Args:
        view: the picture.
        notify: called on another thread when `tick` has something to do.
    """

    def __init__(self, view: MeshView, notify: Callable[[], None] = lambda: None) -> None:
        """Begin without a model."""
        self.view = view
        self.controller = Controller(self)
        self.camera = Camera((0, 0, 5), (0, 0, 0), (0, 1, 0))
        self.mode: Literal["drag", "paint"] = "drag"
        self.gizmo_mode: Mode = "move"
        self.gizmo_shown = True
        self.brush_radius = 0.08  # geodesic, in bounding diagonals
        self.look = Look()
        self.target: Mesh | None = None
        self.on_change: list[Callable[[str], None]] = []
        self.latencies: deque[float] = deque(maxlen=200)  # seconds, from a move to its frame
        self.answer: Answer | None = None
        self._notify = notify
        self._model: DeformationModel | None = None
        self._session: Session | None = None
        self._thread: SolverThread[Request, Answer] | None = None
        self._symmetry: deformer.Symmetry | None = None
        self._selected: frozenset[int] = frozenset()
        self._grasped: Edit | None = None
        self._hover = Hover()
        self._patch: set[int] = set()
        self._dirty = False
        self._asked: dict[int, float] = {}
        self._number = 0
        self._changed_at = 0.0
        self._jobs: list[Iterator[None]] = []
        self.on_frame: Callable[[], None] | None = None
        self.message = ""
        self._paint: Paint | None = None

    # Models and sessions.

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

    def open_model(self, path: str | Path, session: Session | None = None) -> None:
        """Open a model, with a session of it or a new one.

        Raises:
            InputError: no such model, or the session belongs to another.
        """
        model = deformer.load_model(path)
        if session is not None:
            session.check_fits(model, path)
        if self._thread is not None:
            self._thread.close()
        self._model, self._symmetry, self.target, self.answer = model, None, None, None
        name = ModelName(_portable(path), model.fingerprint)
        self._session = session or Session.begin(name, self.start_codes()["Reference"])
        self._selected, self._hover, self._patch = frozenset(), Hover(), set()
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
            "look": {**vars(look), "ghost": "none" if look.ghost == "target" else look.ghost},
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
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"session: damaged view ({error}); remove 'view' from it") from error
        self.change_look(**vars(look))
        self.camera_moved()

    # What the controller sees: see `Stage`.

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the picture in pixels."""
        return self.view.size

    @property
    def sky(self) -> ArrayLike:
        """The model's up direction."""
        return upright_axes(self.up)[1]

    @property
    def up(self) -> str:
        """Name of the model's up axis."""
        return str(self.model.summary.get("up", "y")) if self.is_open else "y"

    @property
    def selected(self) -> frozenset[int]:
        """Ids of the selected handles."""
        return self._selected

    @property
    def edit(self) -> Edit:
        """The present state."""
        return self.session.edit

    @property
    def gizmo(self) -> Gizmo | None:
        """The manipulator of what is selected and can be moved."""
        held = self._movable()
        if not held or not self.gizmo_shown or self.mode == "paint":
            return None
        several = sum(len(handle.vertices) for handle in held) > 1
        centre = point(np.mean([handle.centre for handle in held], axis=0))
        return Gizmo(centre, self.gizmo_mode if several else "move")

    def vertex_at(self, pixel: Pixel) -> int | None:
        """The visible vertex nearest to a pixel on the surface."""
        return self.view.vertex_at(pixel) if self.is_open else None

    def handle_at(self, pixel: Pixel) -> int | None:
        """Id of the visible handle at a pixel: where it is, or its target."""
        if not self.is_open or not self.edit.handles:
            return None
        marks, owners = self._marks()
        both = np.vstack([marks.positions, marks.targets])
        apart = self.camera.project(both, self.size) - pixel
        distance = np.sqrt((apart**2).sum(axis=1))
        for row in np.argsort(distance):
            if distance[row] > _NEAR:
                return None
            if self.view.sees(both[row]) or row >= len(owners):
                return owners[row % len(owners)]
        return None

    def handles_in(self, low: Pixel, high: Pixel) -> list[int]:
        """Ids of the handles within a rectangle of the picture."""
        marks, owners = self._marks()
        if not owners:
            return []
        at = self.camera.project(marks.positions, self.size)
        inside = ((at >= low) & (at <= high)).all(axis=1)
        return sorted({owners[n] for n in np.flatnonzero(inside)})

    def position_of(self, handle: int) -> NDArray[np.float64]:
        """The centre of a handle's targets."""
        return np.array(self.edit.handle(handle).centre)

    def hover(self, found: Hover) -> None:
        """Light up what is under the cursor."""
        if found != self._hover:
            self._hover = found
            self._touch()
            self._emit("hover")

    @property
    def hovered(self) -> Hover:
        """What is under the cursor."""
        return self._hover

    def select(self, handles: Iterable[int], add: bool = False, toggle: bool = False) -> None:
        """Select handles: these alone, these too, or turn each over."""
        new = frozenset(handles)
        if toggle:
            new = self._selected ^ new
        elif add:
            new = self._selected | new
        if new != self._selected:
            self._selected = new
            self._touch()
            self._emit("handles")

    def place(self, vertex: int, add: bool = False) -> int:
        """Put a handle on a vertex where it is now; an old one there is taken instead."""
        for handle in self.edit.handles:
            if handle.vertices == (vertex,):
                self.select([handle.id], add=add)
                return handle.id
        at = point(self.vertices[vertex])
        handle = Handle(self.session.next_id(), (vertex,), (at,))
        self._grasped = None
        self.session.change(self.edit.with_handles([handle]))
        self.select([handle.id], add=add)
        self.ask(moving=True)
        return handle.id

    def move_selected(self, motion: Motion) -> None:
        """Move the selected handles from where they were when this drag began; pins stay."""
        if self._grasped is None:
            self._grasped = self.edit
        held = [h for h in self._grasped.handles if h.id in self._selected and h.kind != "pin"]
        self.session.change(self._grasped.with_handles(h.moved(motion) for h in held))
        self.ask(moving=True)
        self._emit("drag")

    def commit(self, label: str) -> None:
        """End what is under way as one step of the history."""
        self._grasped = None
        answer = self.answer
        fits = answer is not None and answer.request.edit == self.edit
        if self.session.commit(label, answer.solution if answer and fits else None):
            self._emit("history", "handles")
        self.ask()

    def revert(self) -> None:
        """Take back what is under way."""
        self._grasped = None
        self._patch.clear()
        self.view.show_patch(())
        if self.session.under_way:
            self.session.revert()
            self._keep_selection()
            self.ask(self.session.entry.solution)
        self._touch()

    def rubber_band(self, low: Pixel | None, high: Pixel | None) -> None:
        """Draw a rectangle, or none."""
        self.view.show_box(low, high)
        self._touch()

    def brush(self, vertex: int) -> None:
        """Paint the disc around a vertex, along the surface."""
        radius = self.brush_radius * self.model.reference.bounding_diagonal
        row = self.model.geodesics.row(vertex)
        self._patch.update(np.flatnonzero(row <= radius).tolist())
        self.view.show_patch(sorted(self._patch))
        self._touch()

    def finish_region(self, add: bool = False) -> None:
        """Make one handle of the painted region."""
        patch = np.array(sorted(self._patch), dtype=np.int64)
        self._patch.clear()
        self.view.show_patch(())
        self.set_mode("drag")
        if not len(patch):
            return
        rest = self.model.reference.vertices[patch]
        chosen = patch[spread(rest - rest.mean(axis=0), _HOLDS)]
        handle = Handle(
            self.session.next_id(),
            tuple(chosen.tolist()),
            tuple(point(p) for p in self.vertices[chosen]),
            patch=tuple(patch.tolist()),
        )
        self.session.change(self.edit.with_handles([handle]))
        self.select([handle.id], add=add)
        self.commit("Paint region")

    def camera_moved(self) -> None:
        """The camera has another place."""
        self.view.look(self.camera)
        self._touch()
        self._emit("camera")

    # Commands.

    @property
    def vertices(self) -> NDArray[np.float64]:
        """The surface (V, 3) that is shown."""
        return self.model.reference.vertices if self.answer is None else self.answer.pose.vertices

    def change(self, label: str, edit: Edit) -> None:
        """Make a state the next step of the history and solve for it."""
        self.session.change(edit)
        self._keep_selection()
        self.commit(label)

    def undo(self) -> None:
        """Take the last step back."""
        if self.session.can_undo:
            self._show_entry(self.session.undo())

    def redo(self) -> None:
        """Take a step forth again."""
        if self.session.can_redo:
            self._show_entry(self.session.redo())

    def _show_entry(self, entry: Any) -> None:
        self._keep_selection()
        self.ask(entry.solution)
        self._emit("history", "handles")

    def start_codes(self) -> dict[str, NDArray[np.float64]]:
        """Latent codes to start from, by name: the reference and every training shape."""
        model = self.model
        train = model.split.get("train") or range(len(model.codes))
        codes = {f"Shape {n}": z for n, z in zip(train, model.codes, strict=False)}
        first = codes.get(f"Shape {model.summary.get('reference', 0)}")
        if first is None:
            first = model.encode(model.reference.vertices)
        return {"Reference": first, "Mean": model.latent_mean, **codes}

    def start_from(self, name: str, code: ArrayLike) -> None:
        """Lean on a latent code, with no handles."""
        base = tuple(float(value) for value in np.asarray(code))
        self.change(f"Start from {name}", replace(self.edit, base=base, handles=()))

    def start_from_mesh(self, path: str | Path) -> None:
        """Lean on the code whose shape comes closest to a mesh; found beside the window.

        Raises:
            InputError: it has another number of vertices.
        """
        mesh, model, found = self._load_alike(path), self.model, []
        worker = threading.Thread(target=lambda: found.append(model.fit(mesh.vertices)))

        def wait() -> Iterator[None]:
            worker.start()
            while worker.is_alive():
                yield
            if not found:
                raise InputError(f"{path}: no code could be fitted to it; check the mesh")
            if self._model is model:
                self.start_from(Path(path).name, found[0])

        self.run(wait())

    def _load_alike(self, path: str | Path) -> Mesh:
        mesh, reference = io.load_mesh(path), self.model.reference
        if mesh.vertices.shape != reference.vertices.shape:
            raise InputError(
                f"{path}: {len(mesh.vertices)} vertices, expected {len(reference.vertices)} as the "
                "model has; choose a mesh of the same connectivity"
            )
        return mesh

    def reset(self) -> None:
        """Go back to the reference, with no handles."""
        self.start_from("reference", self.start_codes()["Reference"])

    def use_as_base(self) -> None:
        """Lean on the pose that is shown; handles stay where they are."""
        if self.answer is not None:
            self.change("Start from this pose", replace(self.edit, base=self.answer.solution.z))

    def slide(self, component: int, value: float) -> None:
        """Set a component of the code; handles resist. `commit` ends it."""
        if self._grasped is None:
            self._grasped = self.edit
            self._slid_from = self.code
        base = list(self._grasped.base)
        base[component] += value - float(self._slid_from[component])
        self.session.change(replace(self._grasped, base=tuple(base)))
        self.ask(moving=True)

    @property
    def code(self) -> NDArray[np.float64]:
        """The latent code (K,) of the pose that is shown."""
        return np.array(self.edit.base) if self.answer is None else self.answer.pose.z

    def set_noise(self, noise: float) -> None:
        """How hard the prior holds; `commit` ends it."""
        self.session.change(replace(self.edit, noise=noise))
        self.ask(moving=True)

    def set_body(self, body: Body) -> None:
        """Whether the body may turn and travel as a whole."""
        self.change("Body " + body, replace(self.edit, body=body))

    def set_kind(self, kind: Kind) -> None:
        """Make the selected handles soft, exact or pins."""
        held = [replace(h, kind=kind) for h in self._held()]
        if kind == "pin":
            held = [
                replace(h, targets=tuple(point(p) for p in self.vertices[list(h.vertices)]))
                for h in held
            ]
        if held:
            self.change(f"Make {kind}", self.edit.with_handles(held))

    def set_weight(self, weight: float) -> None:
        """Weigh the selected handles; `commit` ends it."""
        held = [replace(handle, weight=weight) for handle in self._held()]
        self.session.change(self.edit.with_handles(held))
        self.ask(moving=True)

    def set_centre(self, centre: ArrayLike) -> None:
        """Move the selected handles so that their common centre is at a point (3,)."""
        held = self._movable()
        if held:
            before = np.mean([handle.centre for handle in held], axis=0)
            shift = np.asarray(centre, dtype=np.float64) - before
            moved = [handle.moved(lambda p: p + shift) for handle in held]
            self.change("Move", self.edit.with_handles(moved))

    def delete(self) -> None:
        """Remove the selected handles."""
        if self._selected:
            self.change("Delete", self.edit.without(self._selected))

    def clear(self) -> None:
        """Remove all handles."""
        if self.edit.handles:
            self.change("Clear handles", replace(self.edit, handles=()))

    @property
    def symmetry(self) -> deformer.Symmetry:
        """The body's mirror plane, found at the first use."""
        if self._symmetry is None:
            self._symmetry = deformer.find_symmetry(self.model.reference)
        return self._symmetry

    @property
    def activations(self) -> deformer.Activations | None:
        """Strengths and limits of the components, once they have been measured."""
        return None if self.answer is None else self.answer.activations

    def preview(self, component: int | None) -> None:
        """Colour the surface by the support of a component, or as before."""
        if self.activations is None:
            return
        if component is None:
            self.view.paint(None if self.answer is None else self._paint)
        else:
            support = self.activations.support(component)
            self.view.paint(Paint(support, "vertices", self.model.label(component), (0.0, 1.0)))
        self._touch()

    def find_symmetry(self) -> None:
        """Find the mirror plane again after `tell_symmetry`."""
        self._symmetry = None

    def tell_symmetry(self, axis: str) -> None:
        """Mirror about the plane through the reference's middle across "x", "y" or "z"."""
        reference = self.model.reference
        middle = 0.5 * (reference.vertices.min(axis=0) + reference.vertices.max(axis=0))
        self._symmetry = deformer.symmetry_about(reference, middle, np.eye(3)["xyz".index(axis)])

    def mirror(self) -> None:
        """Copy the selected handles, or all, to the other side; what is there already moves."""
        symmetry, edit = self.symmetry, self.edit
        number, changed = self.session.next_id(), []
        sources = self._held() or list(edit.handles)
        for handle in sources:
            vertices = tuple(symmetry.opposite[list(handle.vertices)].tolist())
            patch = tuple(sorted(set(symmetry.opposite[list(handle.patch)].tolist())))
            there = [h for h in edit.handles if set(h.vertices) & set(vertices)]
            if any(h.id == handle.id for h in there):
                continue  # on the plane: its own mirror image
            copy = replace(
                handle,
                id=there[0].id if there else number,
                vertices=vertices,
                targets=tuple(point(p) for p in symmetry.mirror(handle.targets)),
                patch=patch,
            )
            number += not there
            changed.append(copy)
        if changed:
            self.change("Mirror", edit.with_handles(changed))
            self.select([h.id for h in changed], add=True)

    def suggest(self) -> None:
        """Place a handle where it would tell most, and show where that is."""
        if self.look.colour != "uncertainty":
            self.change_look(colour="uncertainty")
        elif self.answer is not None and self.answer.suggestion is not None:
            self.place(self.answer.suggestion)
            self.commit("Suggested handle")

    def set_mode(self, mode: Literal["drag", "paint"]) -> None:
        """Drag handles, or paint a region."""
        self.mode = mode
        self._touch()
        self._emit("look")

    def set_gizmo(self, mode: Mode) -> None:
        """What the manipulator of several handles does."""
        self.gizmo_mode, self.gizmo_shown = mode, True
        self._touch()
        self._emit("look")

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
            self.ask(self.answer.solution if self.answer and self._is_final() else None)
        self._touch()
        self._emit("look")

    def _is_final(self) -> bool:
        answer = self.answer
        return answer is not None and answer.final and answer.request.edit == self.edit

    def load_target(self, path: str | Path) -> None:
        """Compare with a mesh of the same connectivity.

        Raises:
            InputError: it has another number of vertices.
        """
        self.target = self._load_alike(path)
        self.change_look(ghost="target", colour="error")

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

    def screenshot(self, path: str | Path) -> None:
        """Write the picture as it is, sharply."""
        save_picture(path, self.view.picture())

    def export_pose(self, path: str | Path) -> None:
        """Write the surface that is shown as a mesh file."""
        io.save_mesh(path, Mesh(self.vertices, self.model.reference.faces))

    def export_handles(self, path: str | Path) -> None:
        """Write the targets as `deformer fit` reads them."""
        vertices, targets, weights, _ = self.edit.arrays()
        if not vertices:
            raise InputError(f"{path}: there are no handles to write; place one first")
        rows = [
            {"vertex": v, "position": list(t), "weight": w}
            for v, t, w in dict(
                (v, (v, t, w)) for v, t, w in zip(vertices, targets, weights, strict=True)
            ).values()
        ]
        io.write_json(path, {"handles": rows})

    # Time.

    def ask(self, solution: Solution | None = None, moving: bool = False) -> None:
        """Have the present state solved."""
        if self._thread is None:
            return
        self._number += 1
        self._asked[self._number] = time.perf_counter()
        target = None if self.target is None else self.target.vertices
        self._thread.ask(
            Request(self.edit, solution, moving, self.look.colour, target, self._number)
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
        return not (self.busy or self.controller.dragging) and self.view.is_sharp

    @property
    def hint(self) -> str:
        """A line that says what the mouse would do here."""
        found = self._hover
        if self.preparing:
            return "Preparing the solver (the first time takes half a minute) …"
        if self.mode == "paint":
            return "Paint a patch with the left button; Esc gives up"
        if found.part is not None:
            return "Drag to move exactly along this part; Shift for a finer step"
        if found.handle is not None:
            return "Drag the handle; S soft, E exact, P pin, Del removes it"
        if found.vertex is not None:
            return f"Vertex {found.vertex}: click to hold it, drag to pull it"
        return "Drag the body to bend it, beside it to look around.  F1: all keys"

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
        waiting = self._thread.busy and now - self._changed_at < _LATE and self.answer is not None
        if self._dirty and (answer is not None or not waiting):
            self._draw(answer)
        elif self._rests(now) and self.view.sharpen(True):
            self.view.render()
        if self._jobs:
            try:
                next(self._jobs[0])
            except StopIteration:
                del self._jobs[0]
            except (InputError, OSError) as error:
                del self._jobs[0]
                self._failed(error)

    def _rests(self, now: float) -> bool:
        return not (self._dirty or self.controller.dragging) and now - self._changed_at > _REST

    def _show(self, answer: Answer) -> None:
        self.answer = answer
        self.view.move_mesh(answer.pose.vertices, answer.normals)
        if answer.paint is not None:
            self._paint = answer.paint
            self.view.paint(answer.paint)
        if answer.final and answer.request.solution is None:
            self.session.solved(answer.request.edit, answer.solution)
        self._dirty = True
        self._emit("pose")

    def _draw(self, answer: Answer | None) -> None:
        self._dirty = False
        self.view.sharpen(False)
        self._update_marks()
        self.view.render()
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
            SELECTED if handle.id in self._selected else KIND_COLOURS[handle.kind]
            for _, _, handle in rows
        ]
        sizes = [
            (8 if handle.is_region else 14) + (4 if handle.id == self._hover.handle else 0)
            for _, _, handle in rows
        ]
        targets = np.array([target for _, target, _ in rows]).reshape(-1, 3)
        return Marks(self.vertices[index], targets, colours, sizes), [h.id for _, _, h in rows]

    def _held(self) -> list[Handle]:
        return [handle for handle in self.edit.handles if handle.id in self._selected]

    def _movable(self) -> list[Handle]:
        return [handle for handle in self._held() if handle.kind != "pin"] if self.is_open else []

    def _keep_selection(self) -> None:
        self._selected &= {handle.id for handle in self.edit.handles}

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


def _lazily(model: DeformationModel) -> Callable[[Request], Iterator[Answer]]:
    """A poser that is prepared with the first request, on the thread that asks."""
    ready: list[Poser] = []

    def answer(request: Request) -> Iterator[Answer]:
        if not ready:
            ready.append(Poser(model))
        return ready[0](request)

    return answer


def _portable(path: str | Path) -> str:
    """A shipped model's name, or an absolute path."""
    return str(path) if str(path) in deformer.shipped_models() else str(Path(path).resolve())


def opening(model: str | None, session: Path | None) -> tuple[str, Session | None]:
    """The model to open first, and the session to open with it.

    Raises:
        InputError: the session is damaged or missing.
    """
    saved = Session.load(session) if session is not None else None
    return model or (saved.model.path if saved else "humanoid"), saved
