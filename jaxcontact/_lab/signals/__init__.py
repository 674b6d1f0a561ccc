"""Readings over time: their clock, noise, and the impacts cut out of them."""
