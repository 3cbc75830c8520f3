"""The paper's figures and the sections of the report."""
