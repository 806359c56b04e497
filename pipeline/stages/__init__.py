"""The stages: one file each, a pure function and a thin main that reads files and writes files."""
