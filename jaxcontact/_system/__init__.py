"""Contacts in any motion: mechanisms from their own equations."""

from .result import SystemContacts as SystemContacts
from .result import SystemMargin as SystemMargin
from .result import SystemPhases as SystemPhases
from .result import SystemRun as SystemRun
from .result import SystemStates as SystemStates
from .simulate import simulate_system as simulate_system
from .system import System as System
