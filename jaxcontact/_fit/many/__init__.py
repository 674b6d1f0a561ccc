"""Many tables fitted at once, each with its own parameters."""
