"""The posterior density of parameters, and draws from it."""
