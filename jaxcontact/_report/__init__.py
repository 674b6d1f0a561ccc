"""A calibration as one page to read, print and send."""

from ._report import PDF as PDF
from ._report import SUFFIXES as SUFFIXES
from ._report import content_of as content_of
from ._report import report as report
