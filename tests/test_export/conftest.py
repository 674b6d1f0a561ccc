"""The simulators of the extra [engines] run only on request: `pytest -m engines`."""


def pytest_collection_modifyitems(config, items):
    if "engines" in config.option.markexpr:
        return
    optional = [item for item in items if item.get_closest_marker("engines")]
    if optional:
        config.hook.pytest_deselected(items=optional)
        items[:] = [item for item in items if item not in optional]
