"""Friction laws of contacts, and the tangential part of an impact in scaled units."""

from .base import AbstractFriction as AbstractFriction
from .base import Tangential as Tangential
from .base import TangentialOutcome as TangentialOutcome
from .coulomb import RegularizedCoulomb as RegularizedCoulomb
from .coulomb import RigidCoulomb as RigidCoulomb
from .coulomb import WaltonFriction as WaltonFriction
from .maw_barber_fawcett import MawBarberFawcett as MawBarberFawcett
from .maw_barber_fawcett import tangential_rebound as tangential_rebound
from .spring_slider import SpringSlider as SpringSlider
