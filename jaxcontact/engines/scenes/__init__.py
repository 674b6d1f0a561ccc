"""Whole scenes as models of other engines."""

from .export_scene import SceneExport as SceneExport
from .export_scene import export_scene as export_scene
from .read_run import read_run as read_run
