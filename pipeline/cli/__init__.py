"""The command line as people type it: what it takes, help, completion, and what the machine can do."""
