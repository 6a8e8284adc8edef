"""Windows of the viewer that leave nothing behind."""

from contextlib import contextmanager

from waiting import wait_for


@contextmanager
def new_window(app, settings):
    """A window, shown until the end of the block and then deleted.

    One that is only closed still gets every change of the style sheet, and its event filters every
    event: each window after it would take longer to open.
    """
    from PySide6.QtCore import QEvent

    from deformer_app.viewer.qt.window import Window

    made = Window(settings)
    try:
        made.show()
        # Before that, nothing is painted, and the screen shows what was there.
        wait_for(lambda: made.windowHandle().isExposed(), app.processEvents)
        yield made
    finally:
        made.close_unsaved()
        made.deleteLater()
        app.sendPostedEvents(None, QEvent.Type.DeferredDelete.value)
