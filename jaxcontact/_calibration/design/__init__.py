"""Design of measurements."""
