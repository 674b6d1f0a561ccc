"""The search for the best fit, and its verdict."""
