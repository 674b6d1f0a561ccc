"""Ready-made fits of a law to what was measured."""
