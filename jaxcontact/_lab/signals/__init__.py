"""Readings over time: clock, noise, and the impacts separated from them."""
