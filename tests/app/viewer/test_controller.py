"""The state machine of mouse and keys, on a stage made of numbers."""

from __future__ import annotations

import numpy as np
import pytest

from deformer_app.rendering.camera import Camera
from deformer_app.viewer.controller import Controller
from deformer_app.viewer.events import (
    ButtonPressed,
    ButtonReleased,
    Keys,
    MouseLeft,
    MouseMoved,
    WheelTurned,
)
from deformer_app.viewer.gizmo import Gizmo
from deformer_app.viewer.stage import Hover
from deformer_app.viewer.view_cube import HALF, centre

SIZE = (400, 400)
CUBE = tuple(centre(SIZE))
FREE, SHIFT, CONTROL, ALT = Keys(), Keys(shift=True), Keys(control=True), Keys(alt=True)


class Stage:
    """A surface that is the disc of 100 pixels about the middle; every pixel of it a vertex."""

    def __init__(self):
        self.camera = Camera((0.0, 0.0, 10.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0))
        self.size, self.sky, self.tool = SIZE, (0.0, 1.0, 0.0), "drag"
        self.gizmo_shown = False
        self.handles: dict[int, np.ndarray] = {}
        self.selected: frozenset[int] = frozenset()
        self.before: dict[int, np.ndarray] | None = None
        self.grasped: dict[int, np.ndarray] | None = None
        self.spans = (1e-3, 100.0)
        self.log: list = []
        self.hovers: list[Hover] = []
        self.measured: list = []

    @property
    def gizmo(self):
        if not self.gizmo_shown or not self.selected:
            return None
        centre = np.mean([self.handles[h] for h in self.selected], axis=0)
        return Gizmo(tuple(centre), "move")

    def vertex_at(self, pixel):
        x, y = np.subtract(pixel, 200)
        return round(1000 * pixel[0] + pixel[1]) if np.hypot(x, y) < 100 else None

    def handle_at(self, pixel):
        for number, place in self.handles.items():
            at = self.camera.project([place], SIZE)[0]
            if np.hypot(*(at - pixel)) < 8:
                return number
        return None

    def cube_at(self, pixel):
        return (0, 0, 1) if np.abs(np.subtract(pixel, CUBE)).max() < HALF else None

    def look_from(self, side):
        self.log.append(("look", side))

    def depth_at(self, pixel):
        return float(self.camera.depths([(0.0, 0.0, 0.0)])[0])

    def context_menu(self, pixel, under):
        self.log.append(("menu", pixel, under))

    def handles_in(self, low, high):
        places = {n: self.camera.project([p], SIZE)[0] for n, p in self.handles.items()}
        return [n for n, p in places.items() if (p >= low).all() and (p <= high).all()]

    def position_of(self, handle):
        return self.handles[handle]

    def hover(self, found):
        self.hovers.append(found)

    def select(self, handles, add=False, toggle=False):
        new = frozenset(handles)
        self.selected = self.selected ^ new if toggle else self.selected | new if add else new

    def place(self, vertex, add):
        self._begin()
        number = len(self.handles) + 1
        pixel = divmod(vertex, 1000)
        self.handles[number] = self.camera.unproject(pixel, 10.0, SIZE)
        self.select([number], add=add)
        self.log.append(("place", vertex))
        return number

    def _begin(self):
        if self.before is None:
            self.before = dict(self.handles)

    def move_selected(self, motion):
        self._begin()
        self.grasped = self.grasped or dict(self.handles)
        for number in self.selected:
            self.handles[number] = motion([self.grasped[number]])[0]

    def measure(self, measure):
        self.measured.append(measure)

    def commit(self, label):
        self.before = self.grasped = None
        self.log.append(("commit", label))

    def revert(self):
        if self.before is not None:
            self.handles, self.before, self.grasped = self.before, None, None
        self.log.append("revert")

    def show_box(self, corners):
        self.log.append(("box", corners))

    def paint_region(self, vertex):
        self.log.append(("brush", vertex))

    def finish_region(self, add):
        self.log.append("region")

    def set_camera(self, camera):
        self.camera = camera
        self.log.append("camera")


@pytest.fixture
def stage():
    return Stage()


@pytest.fixture
def controller(stage):
    return Controller(stage)


def press(controller, button, at, keys=FREE):
    controller.handle(ButtonPressed(button, at, keys))


def move(controller, at, keys=FREE):
    controller.handle(MouseMoved(at, keys))


def release(controller, button, at, keys=FREE):
    controller.handle(ButtonReleased(button, at, keys))


def drag(controller, start, end, keys=FREE, button="left", steps=10):
    press(controller, button, start, keys)
    for n in range(1, steps + 1):
        share = n / steps
        move(controller, tuple((1 - share) * np.array(start) + share * np.array(end)), keys)
    release(controller, button, end, keys)


def click(controller, at, keys=FREE):
    press(controller, "left", at, keys)
    release(controller, "left", at, keys)


def pixel_of(stage, handle):
    return stage.camera.project([stage.handles[handle]], SIZE)[0]


def test_the_vertex_lights_up_before_the_click(stage, controller):
    move(controller, (210, 190))
    assert stage.hovers[-1] == Hover(vertex=210190)
    move(controller, (20, 20))
    assert stage.hovers[-1] == Hover()
    move(controller, (210, 190))
    controller.handle(MouseLeft())
    assert stage.hovers[-1] == Hover()


def test_a_click_places_the_vertex_that_was_lit(stage, controller):
    move(controller, (210, 190))
    click(controller, (210, 190))
    assert stage.log == [("place", 210190), ("commit", "Place handle")]
    assert stage.selected == {1}


def test_a_trembling_click_is_a_click(stage, controller):
    press(controller, "left", (210, 190))
    move(controller, (212, 193))
    release(controller, "left", (211, 192))
    assert stage.log == [("place", 210190), ("commit", "Place handle")]


def test_pressing_and_pulling_places_and_drags_in_one_step(stage, controller):
    drag(controller, (210, 190), (260, 120))
    assert stage.log == [("place", 210190), ("commit", "Place and drag")]
    np.testing.assert_allclose(pixel_of(stage, 1), [260, 120], atol=1e-6)
    # In the camera's plane: the depth is that of the press.
    assert stage.camera.depths([stage.handles[1]])[0] == pytest.approx(10.0)


@pytest.mark.parametrize(
    ("start", "end", "button", "keys"),
    [((20, 20), (210, 190), "left", Keys()), ((210, 190), (250, 190), "right", Keys()),
     ((210, 190), (190, 190), "left", ALT), ((210, 190), (190, 190), "middle", Keys()),
     ((210, 190), (190, 190), "right", SHIFT)],
)  # fmt: skip
def test_no_stray_handle_at_the_end_of_an_orbit_or_pan(stage, controller, start, end, button, keys):
    drag(controller, start, end, keys, button)
    assert set(stage.log) == {"camera"} and not stage.handles
    assert stage.camera != Stage().camera


def test_a_press_on_the_orientation_cube_turns_the_view_and_keeps_the_selection(stage, controller):
    stage.place(200200, False)
    stage.log.clear()
    move(controller, CUBE)
    assert stage.hovers[-1] == Hover(side=(0, 0, 1))
    click(controller, CUBE)
    assert stage.log == [("look", (0, 0, 1))]
    drag(controller, CUBE, (200, 200))
    assert set(stage.log[1:]) == {"camera"}
    assert stage.selected


def test_what_is_seen_through_the_cube_has_priority_and_beside_it_the_cube_turns(stage, controller):
    """The manipulator of a handle below the cube: its axis "y" reaches into the cube."""
    click(controller, (210, 190))
    x, y = CUBE
    stage.handles[1] = stage.camera.unproject((x, y + 40), 10.0, SIZE)
    stage.gizmo_shown = True
    tip = stage.camera.project(stage.gizmo.outline("y", stage.camera, SIZE), SIZE)[1]
    assert stage.cube_at(tip) is not None
    stage.log.clear()
    drag(controller, tuple(tip), (tip[0], tip[1] - 20))
    np.testing.assert_allclose(pixel_of(stage, 1), (x, y + 20), atol=1e-6)
    assert stage.log == [("commit", "Move")]
    drag(controller, tuple(pixel_of(stage, 1)), (x - 5, y - 5))
    np.testing.assert_allclose(pixel_of(stage, 1), (x - 5, y - 5), atol=1e-6)
    stage.vertex_at = lambda pixel: 5 if pixel == (x - 20, y + 18) else None
    move(controller, (x - 20, y + 18))
    assert stage.hovers[-1] == Hover(vertex=5)
    stage.log.clear()
    click(controller, (x - 20, y + 20))
    assert stage.log == [("look", (0, 0, 1))] and stage.selected == {1}
    # A click on the manipulator acts on the body below it, here on nothing.
    end = stage.camera.project(stage.gizmo.outline("x", stage.camera, SIZE), SIZE)[1]
    click(controller, (x + 20, end[1]))
    assert stage.log == [("look", (0, 0, 1))] and not stage.selected


def test_a_handle_behind_the_cube_that_cannot_be_moved_is_left_to_the_cube(stage, controller):
    click(controller, (210, 190))
    stage.handles[1] = stage.camera.unproject(CUBE, 10.0, SIZE)
    stage.log.clear()
    click(controller, CUBE)
    assert stage.log == [("look", (0, 0, 1))]


def test_a_click_beside_the_body_selects_nothing(stage, controller):
    click(controller, (210, 190))
    click(controller, (20, 20))
    assert stage.selected == frozenset() and stage.camera == Stage().camera


def test_orbiting_keeps_the_selection(stage, controller):
    click(controller, (210, 190))
    drag(controller, (20, 20), (60, 40))
    assert stage.selected == {1}


def test_dragging_a_handle_brings_it_under_the_mouse(stage, controller):
    click(controller, (210, 190))
    stage.log.clear()
    drag(controller, (213, 192), (300, 100))  # grasped beside its centre
    np.testing.assert_allclose(pixel_of(stage, 1), [297, 98], atol=1e-6)
    assert stage.log == [("commit", "Drag")]


def test_shift_makes_a_finer_step_from_where_it_is_pressed(stage, controller):
    click(controller, (210, 190))
    press(controller, "left", (210, 190))
    move(controller, (250, 190))
    move(controller, (350, 190), SHIFT)
    release(controller, "left", (350, 190), SHIFT)
    np.testing.assert_allclose(pixel_of(stage, 1), [260, 190], atol=1e-6)


def test_several_handles_move_together(stage, controller):
    click(controller, (180, 190))
    click(controller, (220, 190), SHIFT)
    assert stage.selected == {1, 2}
    drag(controller, (180, 190), (180, 150))
    np.testing.assert_allclose(pixel_of(stage, 1), [180, 150], atol=1e-6)
    np.testing.assert_allclose(pixel_of(stage, 2), [220, 150], atol=1e-6)


def test_a_box_selects_what_is_inside(stage, controller):
    for at in ((150, 200), (200, 200), (250, 200)):
        click(controller, at)
    drag(controller, (140, 150), (210, 250), CONTROL)
    assert stage.selected == {1, 2}
    assert stage.log[-1] == ("box", None)
    drag(controller, (260, 210), (240, 190), Keys(control=True, shift=True))
    assert stage.selected == {1, 2, 3}


def test_a_click_on_one_of_several_selects_it_alone_and_shift_turns_it_over(stage, controller):
    click(controller, (180, 190))
    click(controller, (220, 190), SHIFT)
    click(controller, (180, 190))
    assert stage.selected == {1}
    click(controller, (220, 190), SHIFT)
    assert stage.selected == {1, 2}
    click(controller, (220, 190), SHIFT)
    assert stage.selected == {1}


def test_the_manipulator_moves_exactly_along_an_axis(stage, controller):
    click(controller, (200, 200))
    stage.gizmo_shown = True
    before = stage.handles[1].copy()
    tip = stage.camera.project(stage.gizmo.outline("x", stage.camera, SIZE), SIZE)[1]
    move(controller, tuple(tip))
    assert stage.hovers[-1] == Hover(part="x")
    drag(controller, tuple(tip), (tip[0] + 40, tip[1] + 90))
    moved = stage.handles[1] - before
    assert moved[0] > 0.1
    np.testing.assert_allclose(moved[1:], 0, atol=1e-9)
    assert stage.log[-1] == ("commit", "Move")


@pytest.mark.parametrize("where", [(210, 190), (20, 20)])
def test_escape_takes_a_drag_back(stage, controller, where):
    camera = stage.camera
    press(controller, "left", where)
    move(controller, (where[0] + 50, where[1]))
    assert controller.dragging
    assert controller.cancel()
    assert not controller.dragging and not controller.cancel()
    assert stage.handles == {} and stage.camera == camera
    release(controller, "left", where)
    assert not any(entry[0] == "commit" for entry in stage.log if entry != "revert")


def test_a_drag_goes_on_in_a_view_that_the_right_button_turns(stage, controller):
    """The handle stays under the mouse, and where it is in space, while the view turns."""
    press(controller, "left", (210, 190))
    move(controller, (230, 190))
    before = stage.handles[1].copy()
    press(controller, "right", (230, 190))
    for x in range(230, 281, 10):
        move(controller, (x, 190))
        np.testing.assert_allclose(pixel_of(stage, 1), [x, 190], atol=1e-6)
    np.testing.assert_array_equal(stage.handles[1], before)
    release(controller, "right", (280, 190))
    assert controller.dragging and stage.camera.axes()[2] @ (0.0, 0.0, 1.0) < 0.99
    depth = stage.camera.depths([before])[0]
    move(controller, (290, 170))
    np.testing.assert_allclose(pixel_of(stage, 1), [290, 170], atol=1e-6)
    assert stage.camera.depths([stage.handles[1]])[0] == pytest.approx(depth)
    release(controller, "left", (300, 150))
    np.testing.assert_allclose(pixel_of(stage, 1), [300, 150], atol=1e-6)
    assert stage.log[-1] == ("commit", "Place and drag")


@pytest.mark.parametrize("button", ["right", "middle"])
def test_the_left_button_ends_its_drag_while_another_one_is_down(stage, controller, button):
    press(controller, "left", (210, 190))
    move(controller, (230, 190))
    press(controller, button, (230, 190))
    move(controller, (260, 190))
    release(controller, "left", (260, 190))
    assert stage.log[-1] == ("commit", "Place and drag") and controller.dragging
    before, view = stage.handles[1].copy(), stage.camera
    move(controller, (280, 190))
    assert stage.camera != view and (stage.handles[1] == before).all()
    release(controller, button, (280, 190))
    assert not controller.dragging


def test_the_wheel_zooms_during_a_drag(stage, controller):
    press(controller, "left", (210, 190))
    move(controller, (230, 150))
    before = stage.handles[1].copy()
    controller.handle(WheelTurned(3.0, (230, 150)))
    np.testing.assert_allclose(pixel_of(stage, 1), [230, 150], atol=1e-6)
    np.testing.assert_array_equal(stage.handles[1], before)
    release(controller, "left", (260, 120))
    np.testing.assert_allclose(pixel_of(stage, 1), [260, 120], atol=1e-6)


def test_any_order_of_buttons_ends_without_a_drag(stage, controller):
    """Whatever is pressed and released: no drag lasts once its button is up."""
    random = np.random.default_rng(0)
    down: set[str] = set()
    for _ in range(2000):
        at = tuple(random.uniform(0, 400, 2))
        button = str(random.choice(["left", "middle", "right"]))
        kind = random.integers(4)
        if kind == 0 and button not in down:
            down.add(button)
            press(controller, button, at, Keys(shift=bool(random.integers(2))))
        elif kind == 1 and button in down:
            down.discard(button)
            release(controller, button, at)
        elif kind == 2:
            controller.handle(MouseMoved(at, FREE, frozenset(down)))
        else:
            controller.handle(WheelTurned(float(random.choice([-1, 1])), at))
        assert controller.dragging <= bool(down)
        assert np.isfinite(stage.camera.position).all()
    for button in sorted(down):
        release(controller, button, (200, 200))
    assert not controller.dragging and stage.before is None


def test_a_release_that_is_never_told_ends_the_drag_at_the_next_move(stage, controller):
    press(controller, "left", (210, 190))
    controller.handle(MouseMoved((230, 190), FREE, frozenset({"left"})))
    controller.handle(MouseMoved((300, 100), FREE, frozenset()))
    assert not controller.dragging and stage.log[-1] == ("commit", "Place and drag")
    np.testing.assert_allclose(pixel_of(stage, 1), [230, 190], atol=1e-6)
    release(controller, "left", (300, 100))
    assert stage.log[-1] == ("commit", "Place and drag")


def test_a_second_press_of_the_same_button_ends_the_drag_before(stage, controller):
    press(controller, "left", (210, 190))
    move(controller, (230, 190))
    press(controller, "left", (20, 20))
    assert stage.log[-1] == ("commit", "Place and drag")
    release(controller, "left", (20, 20))
    assert not controller.dragging and stage.selected == frozenset()


def test_a_right_click_asks_for_a_menu_and_a_right_drag_does_not(stage, controller):
    press(controller, "right", (210, 190))
    move(controller, (212, 191))
    release(controller, "right", (211, 191))
    assert stage.log == [("menu", (210, 190), Hover(vertex=210190))]
    stage.log.clear()
    drag(controller, (210, 190), (260, 190), button="right")
    assert set(stage.log) == {"camera"}


def test_zooming_has_limits(stage, controller):
    for notches, limit in ((1.0, stage.spans[0]), (-1.0, stage.spans[1])):
        for _ in range(200):
            controller.handle(WheelTurned(notches, (210, 190)))
        span = SIZE[1] * stage.camera.pixel_size((0.0, 0.0, 0.0), SIZE)
        assert span == pytest.approx(limit)
    stage.spans = (1.0, 10.0)  # a camera beyond a limit still comes back
    controller.handle(WheelTurned(1.0, (210, 190)))
    assert SIZE[1] * stage.camera.pixel_size((0, 0, 0), SIZE) == pytest.approx(100 / 1.15)


@pytest.mark.parametrize("selects", [True, False])
def test_a_click_on_the_manipulator_acts_on_what_is_under_it(stage, controller, selects):
    click(controller, (200, 200))
    tip = stage.camera.project(Gizmo((0, 0, 0), "move").outline("x", stage.camera, SIZE), SIZE)[1]
    at = tuple(np.floor(tip))
    if selects:
        stage.handles[2] = stage.camera.unproject(at, 10.0, SIZE)
    stage.gizmo_shown = True
    move(controller, at)
    assert stage.hovers[-1] == Hover(part="x")
    click(controller, at)
    assert stage.selected == {2} and len(stage.handles) == 2
    assert stage.log.count(("commit", "Place handle")) == (1 if selects else 2)
    assert ("commit", "Move") not in stage.log


def test_inside_a_square_of_the_manipulator_a_handle_can_be_grasped(stage, controller):
    click(controller, (200, 200))
    gizmo = Gizmo((0.0, 0.0, 0.0), "move")
    at = stage.camera.project(gizmo.outline("xy", stage.camera, SIZE), SIZE)[:4].mean(axis=0)
    stage.gizmo_shown = True
    move(controller, tuple(at))
    assert stage.hovers[-1] == Hover(part="xy")
    stage.handles[2] = stage.camera.unproject(at, 10.0, SIZE)
    drag(controller, tuple(at), tuple(at + 30))
    assert stage.selected == {2}
    np.testing.assert_allclose(pixel_of(stage, 2), at + 30, atol=1e-6)


def test_the_wheel_zooms_to_the_cursor(stage, controller):
    under = stage.camera.unproject((300, 100), 10.0, SIZE)
    controller.handle(WheelTurned(2.0, (300, 100)))
    assert stage.camera.depths([(0, 0, 0)])[0] < 10
    np.testing.assert_allclose(stage.camera.project([under], SIZE)[0], [300, 100], atol=1e-6)


def test_painting_strokes_vertices_and_ends_in_a_region(stage, controller):
    stage.tool = "paint"
    drag(controller, (190, 200), (210, 200), steps=4)
    brushed = [entry[1] for entry in stage.log if entry[0] == "brush"]
    assert brushed[0] == 190200 and brushed[-1] == 210200
    assert stage.log[-1] == "region"
    drag(controller, (20, 20), (40, 20))
    assert stage.log[-1] == "camera", "beside the body it orbits"
