"""Tables of oblique impacts, and the friction law that describes them."""
