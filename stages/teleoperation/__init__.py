"""Shared teleoperation: one master moves two arms that hold an object between them. Paper section II-B."""
