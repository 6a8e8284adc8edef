"""An area that scrolls up and down, and is never narrower than what it shows."""

from __future__ import annotations

from PySide6.QtCore import QEvent, QSize, Qt
from PySide6.QtWidgets import QFrame, QScrollArea, QWidget


class VerticalScroll(QScrollArea):
    """Shows a widget of any height; its minimum width is the widget's, beside the scroll bar.

    Without that minimum, a dock may be so narrow that its contents are cut off at the right.
    """

    def __init__(self) -> None:
        """Start empty."""
        super().__init__()
        self.setWidgetResizable(True)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.setFrameShape(QFrame.Shape.NoFrame)
        self.setFocusPolicy(Qt.FocusPolicy.ClickFocus)  # Tab goes on to what is in it

    def setWidget(self, widget: QWidget) -> None:
        """Show a widget, in place of the one before, which is deleted."""
        super().setWidget(widget)
        self.updateGeometry()

    def minimumSizeHint(self) -> QSize:
        """Return the smallest size; only its width depends on the widget."""
        smallest = super().minimumSizeHint()
        widget: QWidget | None = self.widget()
        if widget is not None:
            width = widget.minimumSizeHint().width()
            smallest.setWidth(width + self.verticalScrollBar().sizeHint().width())
        return smallest

    def viewportEvent(self, event: QEvent) -> bool:
        """Tell the layout that has this area when the widget's smallest size may have changed."""
        if event.type() == QEvent.Type.LayoutRequest:
            self.updateGeometry()
        return super().viewportEvent(event)
