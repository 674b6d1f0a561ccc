"""Pictures of recordings and their calibration."""
