"""The parquet tables that the stages hand on: one module a table, schemas with units."""
