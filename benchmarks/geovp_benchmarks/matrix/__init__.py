"""Matrix files: schema, built-in files and protocols."""
