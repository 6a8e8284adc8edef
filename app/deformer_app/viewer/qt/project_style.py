"""Qt's style with the project's icons in dialogs, and a tool bar that shows when it has more."""

from __future__ import annotations

from PySide6.QtGui import QIcon
from PySide6.QtWidgets import QProxyStyle, QStyle, QStyleOption, QWidget

from deformer_app.viewer.qt.icons import icon

_Kind, _Metric = QStyle.StandardPixmap, QStyle.PixelMetric
_MORE = 28  # pixels of the button of a tool bar that has more than fits
_ICONS = {
    _Kind.SP_ArrowBack: "arrow-left",
    _Kind.SP_ArrowForward: "arrow-right",
    _Kind.SP_ComputerIcon: "monitor",
    _Kind.SP_DesktopIcon: "monitor",
    _Kind.SP_DirClosedIcon: "folder",
    _Kind.SP_DirHomeIcon: "house",
    _Kind.SP_DirIcon: "folder",
    _Kind.SP_DirLinkIcon: "folder",
    _Kind.SP_DirOpenIcon: "folder-open",
    _Kind.SP_DriveHDIcon: "monitor",
    _Kind.SP_FileDialogContentsView: "layout-grid",
    _Kind.SP_FileDialogDetailedView: "list",
    _Kind.SP_FileDialogListView: "layout-grid",
    _Kind.SP_FileDialogNewFolder: "folder-plus",
    _Kind.SP_FileDialogToParent: "arrow-up",
    _Kind.SP_FileIcon: "file",
    _Kind.SP_FileLinkIcon: "file",
    _Kind.SP_MessageBoxCritical: "circle-x",
    _Kind.SP_MessageBoxInformation: "info",
    _Kind.SP_MessageBoxQuestion: "circle-question-mark",
    _Kind.SP_MessageBoxWarning: "triangle-alert",
}


class ProjectStyle(QProxyStyle):
    """Fusion, with the project's icons in dialogs and room for one in a tool bar that has more."""

    def __init__(self) -> None:
        """Take Fusion as the base."""
        super().__init__("Fusion")

    def standardIcon(
        self,
        standardIcon: QStyle.StandardPixmap,
        option: QStyleOption | None = None,
        widget: QWidget | None = None,
    ) -> QIcon:
        """Return the project's icon of a kind, or else the base's."""
        name = _ICONS.get(standardIcon)
        return super().standardIcon(standardIcon, option, widget) if name is None else icon(name)

    def pixelMetric(
        self,
        metric: QStyle.PixelMetric,
        option: QStyleOption | None = None,
        widget: QWidget | None = None,
    ) -> int:
        """Return a length in pixels."""
        if metric == _Metric.PM_ToolBarExtensionExtent:
            return _MORE
        return super().pixelMetric(metric, option, widget)
