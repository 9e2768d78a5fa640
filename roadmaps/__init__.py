"""placeholder"""

from roadmaps.workspace import Workspace
