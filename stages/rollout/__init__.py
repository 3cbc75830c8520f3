"""Policy x world x cases: the roll-outs of an experiment."""
