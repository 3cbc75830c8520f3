"""Recordings of every format behind one protocol (`stages/ingest/recording.py`): start with `formats.py`."""
