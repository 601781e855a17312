"""The daemon: life cycle, control API, experiments."""
