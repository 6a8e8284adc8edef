"""The editor in a plain pyvista window: keys and mouse, no menus, nothing but pyvista needed."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any

import pyvista as pv

from deformer import InputError
from deformer_app.viewer.actions import ACTIONS, help_text
from deformer_app.viewer.controller import Keys
from deformer_app.viewer.editor import Editor
from deformer_app.viewer.events import listen
from deformer_app.viewer.scene import MeshView
from deformer_app.viewer.session import Session

_PAUSE = 0.004  # seconds between two looks at the events
_NAMES = {"Delete": "Del", "BackSpace": "Del", "question": "F1", "bracketleft": "[",
          "bracketright": "]"}  # fmt: skip


class PlainWindow:
    """An editor in a window of pyvista.

    Args:
        model: what to open.
        session: a session to open with it.
        file: where the session came from and is saved to.
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
        self.plotter: Any = pv.Plotter(window_size=list(size), title="Deformer", lighting="none")
        self.plotter.show(interactive_update=True, auto_close=False)
        self.editor = Editor(MeshView(self.plotter))
        self._file = file or Path("session.json")
        self._open, self._asked_to_close, self._helping = True, False, False
        self._keys = {action.key: action for action in ACTIONS if action.key}
        self.editor.on_change.append(self._changed)
        listen(self.editor.view, self.editor.controller, self._key)
        self.plotter.iren.interactor.AddObserver("ExitEvent", self._exit)
        self.editor.open_model(model, session)
        self._changed("frame")

    def run(self) -> Session:
        """Serve the window until it is closed; the session."""
        interactor = self.plotter.iren
        while self._open:
            interactor.process_events()
            self.editor.tick()
            time.sleep(_PAUSE)
        self.editor.close()
        self.plotter.close()
        return self.editor.session

    def _exit(self, *_: Any) -> None:
        self._open = False

    def _key(self, name: str, keys: Keys) -> None:
        if name == "Escape":
            if not self.editor.controller.cancel() and self._helping:
                self.help()
            return
        name = _NAMES.get(name, name.upper() if len(name) == 1 else name)
        pressed = "Ctrl+" * keys.control + "Shift+" * keys.shift + name
        action = self._keys.get(pressed)
        if action is None:
            return
        if action.dialog:
            self._say(f"{action.title.rstrip('…')} needs the full window: leave out --plain")
            return
        try:
            action.run(self)  # pyright: ignore[reportArgumentType]
        except (InputError, OSError) as error:
            self._say(str(error))

    def _changed(self, event: str) -> None:
        editor = self.editor
        if event == "message":
            self._say(editor.message)
        elif event == "notice":
            self._say(editor.notice)
        elif event == "frame" and not self._asked_to_close:
            editor.view.write("bottom", editor.hint)
            solve = editor.answer.pose.milliseconds if editor.answer else 0.0
            frame = editor.view.frame_milliseconds
            editor.view.write("top", f"solve {solve:.1f} ms   frame {frame:.1f} ms")

    def _say(self, text: str) -> None:
        self.editor.view.write("bottom", text)
        self.editor.view.render()

    # What actions ask for; see `actions.Shell`.

    def save(self, elsewhere: bool) -> bool:
        """Save the session to the file that it came from."""
        self.editor.save_session(self._file)
        self._asked_to_close = False
        self._say(f"Saved {os.fspath(self._file)}")
        return True

    def help(self) -> None:
        """Show or hide the help."""
        self._helping = not self._helping
        self.editor.view.write("middle", help_text() if self._helping else "")
        self.editor.view.render()

    tour = help

    def close(self) -> None:
        """End; the second time if there is unsaved work."""
        if self.editor.session.changed and not self._asked_to_close:
            self._asked_to_close = True
            self._say("Unsaved changes: Ctrl+S saves, Ctrl+Q again closes without")
        else:
            self._open = False
