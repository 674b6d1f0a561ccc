"""The laboratory: from recordings and records of instruments to the law that reproduces them."""
