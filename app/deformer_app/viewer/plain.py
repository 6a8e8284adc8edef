"""The editor in a plain pyvista window: keys and mouse, no menus, nothing but pyvista needed."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any

import pyvista as pv

from deformer import InputError
from deformer_app.mistakes import mistake
from deformer_app.viewer.actions import ACTIONS, carry_out
from deformer_app.viewer.changes import (
    Change,
    FrameDrawn,
    MistakeMade,
    ModelOpened,
    NoticeGiven,
    PoseChanged,
)
from deformer_app.viewer.editor import Editor
from deformer_app.viewer.events import KeyPressed
from deformer_app.viewer.help import help_text
from deformer_app.viewer.scene import MeshView
from deformer_app.viewer.session import Session
from deformer_app.viewer.settings import EditInterrupted, Settings
from deformer_app.viewer.vtk_input import listen

_PREPARING = "Deformer (preparing)"
_PAUSE = 0.004  # seconds between two polls of the events
_NAMES = {"Delete": "Del", "bracketleft": "[", "bracketright": "]", "space": "Space",
          "plus": "+", "minus": "-"}  # fmt: skip


class PlainWindow:
    """An editor in a window of pyvista.

    Args:
        model: name or path of the model to open.
        session: a session to open with it.
        file: file that the session was read from and is saved to.
        size: of the window in pixels.
    """

    def __init__(
        self,
        model: str | Path,
        session: Session | None = None,
        file: Path | None = None,
        size: tuple[int, int] = (1100, 850),
    ) -> None:
        """Open the window."""
        self.plotter: Any = pv.Plotter(window_size=list(size), title=_PREPARING, lighting="none")
        self.plotter.show(interactive_update=True, auto_close=False)
        self.editor = Editor(MeshView(self.plotter))
        self._file = file or Path("session.json")
        self._open, self._asked_to_close, self._helping = True, False, False
        self._keys = {key: action for action in ACTIONS for key in action.keys}
        self.editor.on_change.append(self._hear)
        listen(self.editor.state.view, self.editor.controller.handle, self._handle_key)
        self.plotter.iren.interactor.AddObserver("ExitEvent", self._exit)
        self.editor.open_model(model, session)
        self._show_status()

    def run(self) -> Session:
        """Serve the window until it is closed; the session.

        Raises:
            EditInterrupted: Ctrl-C in the terminal.
        """
        try:
            self._serve()
        except KeyboardInterrupt:
            raise EditInterrupted(self._keep()) from None
        self.editor.close()
        self.plotter.close()
        return self.editor.session

    def _serve(self) -> None:
        interactor = self.plotter.iren
        while self._open:
            interactor.process_events()
            self.editor.tick()
            # Drawing holds Python's lock, so that on a busy machine the solver would never run.
            frame = self.editor.state.view.frame_milliseconds / 1000
            time.sleep(max(_PAUSE, frame) if self.editor.preparing else _PAUSE)

    def _keep(self) -> Path | None:
        """Write unsaved work where the full window keeps its own; return the file."""
        if not self.editor.session.changed:
            return None
        settings = Settings()
        self.editor.write_copy(settings.autosave)
        settings.close(keep=True)
        return settings.autosave

    def _exit(self, *_: Any) -> None:
        self._open = False

    def _handle_key(self, event: KeyPressed) -> None:
        if self.editor.controller.handle_key(event):
            return
        if event.name == "Escape":
            if not self.editor.controller.cancel() and self._helping:
                self.help()
            return
        name = event.name
        name = _NAMES.get(name, name.upper() if len(name) == 1 else name)
        pressed = "Ctrl+" * event.keys.control + "Shift+" * event.keys.shift + name
        action = self._keys.get(pressed)
        if action is None or not action.enabled(self.editor):
            return
        if action.dialog:
            self._say(f"{action.title.rstrip('…')} needs the full window: leave out --plain")
            return
        try:
            carry_out(action, self)  # pyright: ignore[reportArgumentType]
        except (InputError, OSError) as error:
            self._say(mistake(error))

    def _hear(self, change: Change) -> None:
        match change:
            case MistakeMade(text) | NoticeGiven(text):
                self._say(text)
            case ModelOpened():
                self.plotter.render_window.SetWindowName(_PREPARING)
            case PoseChanged():
                name = Path(self.editor.session.model.path).name
                self.plotter.render_window.SetWindowName(f"{name} - Deformer")
            case FrameDrawn() if not self._asked_to_close:
                self._show_status()

    def _show_status(self) -> None:
        editor, view = self.editor, self.editor.state.view
        view.overlays.write("bottom", editor.stage.hint)
        solve = editor.answer.pose.milliseconds if editor.answer else 0.0
        text = f"solve {solve:.1f} ms   frame {view.frame_milliseconds:.1f} ms"
        view.overlays.write("top", text)

    def _say(self, text: str) -> None:
        self.editor.state.view.overlays.write("bottom", text)
        self.editor.state.view.render()

    # Functions that actions call; see `actions.Shell`.

    def save(self, elsewhere: bool) -> bool:
        """Save the session to the file that it came from."""
        self.editor.save_session(self._file)
        self._asked_to_close = False
        self._say(f"Saved {os.fspath(self._file)}")
        return True

    def choose_theme(self, dark: bool | None) -> None:
        """Show the dark or the light theme; the light one for None."""
        self.editor.picture.change_look(dark=bool(dark))

    def help(self) -> None:
        """Show or hide the help."""
        self._helping = not self._helping
        view = self.editor.state.view
        view.overlays.write("middle", help_text() if self._helping else "")
        view.render()

    begin_tour = help

    def close(self) -> None:
        """Close the window; with unsaved work, only at the second call."""
        if self.editor.session.changed and not self._asked_to_close:
            self._asked_to_close = True
            self._say("Unsaved changes: Ctrl+S saves, Ctrl+Q again closes without")
        else:
            self._open = False
