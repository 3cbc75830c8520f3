"""Which numbers of a recording are an arm's pose or force: start with `selection.py`."""
