"""The daemon in one thread on a virtual clock: every order of commands, and who goes next, chosen from a seed."""
