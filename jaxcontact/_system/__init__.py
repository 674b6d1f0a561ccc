"""Contacts in any motion: mechanisms from their own equations."""

from .readout.result import SystemContacts as SystemContacts
from .readout.result import SystemMargin as SystemMargin
from .readout.result import SystemPhases as SystemPhases
from .readout.result import SystemRun as SystemRun
from .readout.result import SystemStates as SystemStates
from .simulate import simulate_system as simulate_system
from .system import System as System
