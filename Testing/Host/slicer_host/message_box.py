"""CTK's message box."""

from __future__ import annotations

from PySide6 import QtWidgets

from .standin import stored


class ctkMessageBox(QtWidgets.QMessageBox):
    """A message box; the box to tick for not showing it again is left out."""

    dontShowAgain = stored(bool, "dontShowAgain", False)
    dontShowAgainVisible = stored(bool, "dontShowAgainVisible", False)
    dontShowAgainSettingsKey = stored(str, "dontShowAgainSettingsKey", "")
