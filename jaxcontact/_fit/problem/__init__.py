"""A fit as a problem: model, parameters, target and loss."""
