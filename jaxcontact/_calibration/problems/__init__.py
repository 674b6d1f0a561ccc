"""Ready-made fits of a law to measurements."""
