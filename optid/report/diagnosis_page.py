"""The page of a diagnosis, from what the diagnosis package holds in memory."""

from __future__ import annotations

from typing import TYPE_CHECKING

from optid.report.diagnosis_result import diagnosis_result
from optid.report.views.diagnosis import page

if TYPE_CHECKING:
    from optid.diagnosis.result import Diagnosis


def diagnosis_page(found: Diagnosis) -> str:
    """The report of `optid diagnose`."""
    return page(diagnosis_result(found))
