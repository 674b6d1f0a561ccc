"""A calibration as a one-page report."""

from .write import PDF as PDF
from .write import SUFFIXES as SUFFIXES
from .write import content_of as content_of
from .write import report as report
