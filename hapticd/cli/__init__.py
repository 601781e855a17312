"""The command line: one thin module a command group, every heavy import inside the command that needs it."""
