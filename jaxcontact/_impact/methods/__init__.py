"""Methods that solve an impact."""
